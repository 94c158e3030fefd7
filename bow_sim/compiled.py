"""Numba's decorators, for the modules whose functions run compiled.

Numba's annotations describe an intrinsic with the arguments it has at compile time, and know no
option beyond the documented ones; here they are plain functions to the type checker.
"""

from __future__ import annotations

from typing import Any

import numba
from numba import extending

njit: Any = numba.njit
intrinsic: Any = extending.intrinsic
overload: Any = extending.overload
register_model: Any = extending.register_model

INLINE: dict[str, Any] = {"nogil": True, "_nrt": False, "forceinline": True}
"""Options of the kernel's parts: no reference counts and no calls within the time loop."""
