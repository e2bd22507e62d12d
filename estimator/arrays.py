"""Names for the arrays and the checked numbers that every room shares."""

from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ShortArray = NDArray[np.int32]
IndexArray = NDArray[np.uint32]
FlagArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Count = Annotated[int, Meta(ge=1)]
