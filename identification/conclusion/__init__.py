"""From a fit to a result: what its recordings are worth, predictions, named parameters, a consistent arm."""
