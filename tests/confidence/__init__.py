"""How often a name of the diagnosis is right: a bank of cases with known answers, and the table fitted to it."""
