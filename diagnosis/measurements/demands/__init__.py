"""Effects that show in measured against demanded angles."""
