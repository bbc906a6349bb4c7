"""One file per identification method."""
