"""One file per command of ``armscope``."""
