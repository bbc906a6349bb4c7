"""Other effects in the place of those that a search chose: simpler ones, or no more coefficients.

Forward selection takes, at every step, the law that predicts held-out rows best. What was still missing then may have
made another law the better one; each rule of this room undoes one such choice, by the exact model.
"""
