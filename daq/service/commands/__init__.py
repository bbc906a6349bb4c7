"""Commands as they come from strangers: bounded, checked, queued; and whose clients still live."""
