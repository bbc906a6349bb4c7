"""Effects that show in the measured angles beside the demanded ones."""
