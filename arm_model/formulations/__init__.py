"""The equations of motion three ways: Newton-Euler (the one that is compiled), Lagrange, Kane; and what each costs."""
