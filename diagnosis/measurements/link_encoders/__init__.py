"""Effects that show between motor and link encoders."""
