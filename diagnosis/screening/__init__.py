"""Events in raw rows and checks for plausibility, before anything is fitted."""
