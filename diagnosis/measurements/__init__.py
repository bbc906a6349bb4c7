"""One package per kind of measurement that shows an effect: each makes columns, selects causes and words them."""
