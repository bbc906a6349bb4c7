"""The bytes of a row: CDR messages of ROS 2, side by side in a structured numpy type."""
