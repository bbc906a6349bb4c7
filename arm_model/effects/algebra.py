"""The functions that laws of effects are written in, over numpy arrays. The tape and sympy offer the same names."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Algebra(Protocol):
    """What a law may call besides + - * / and powers by whole numbers."""

    def sin(self, x: Any) -> Any: ...
    def cos(self, x: Any) -> Any: ...
    def exp(self, x: Any) -> Any: ...
    def sqrt(self, x: Any) -> Any: ...
    def absolute(self, x: Any) -> Any: ...
    def maximum(self, x: Any, y: Any) -> Any: ...
    def minimum(self, x: Any, y: Any) -> Any: ...


class Arrays:
    """The algebra of numpy arrays."""

    sin = staticmethod(np.sin)
    cos = staticmethod(np.cos)
    exp = staticmethod(np.exp)
    sqrt = staticmethod(np.sqrt)
    absolute = staticmethod(np.abs)
    maximum = staticmethod(np.maximum)
    minimum = staticmethod(np.minimum)


class Symbols:
    """The algebra of sympy expressions, for printing."""

    @staticmethod
    def sin(x: Any) -> Any:
        import sympy

        return sympy.sin(x)

    @staticmethod
    def cos(x: Any) -> Any:
        import sympy

        return sympy.cos(x)

    @staticmethod
    def exp(x: Any) -> Any:
        import sympy

        return sympy.exp(x)

    @staticmethod
    def sqrt(x: Any) -> Any:
        import sympy

        return sympy.sqrt(x)

    @staticmethod
    def absolute(x: Any) -> Any:
        import sympy

        return sympy.Abs(x)

    @staticmethod
    def maximum(x: Any, y: Any) -> Any:
        import sympy

        return sympy.Max(x, y)

    @staticmethod
    def minimum(x: Any, y: Any) -> Any:
        import sympy

        return sympy.Min(x, y)
