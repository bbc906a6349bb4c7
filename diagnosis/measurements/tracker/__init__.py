"""Effects that show in the position of a target measured by an external tracker."""
