"""An arm as text: its joints and parameters, its equations, the effects that it may have; ``armscope model``."""
