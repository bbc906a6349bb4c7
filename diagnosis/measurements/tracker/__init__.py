"""Effects that show in the position of a target seen by an external tracker."""
