"""Read the maps of ROS map_server: a YAML file beside a grey image (pgm, png and whatever else Pillow opens).

The image's lowest row is the map's first. How dark a pixel is says how occupied its cell is, or how light if
`negate`; `mode` says what becomes of that:

- trinary: above occupied_thresh occupied, below free_thresh free, in between unknown. A colour is the mean of
  its channels, and transparency counts as one more of them.
- scale: as trinary, but in between the occupancy grows evenly from 0 to 100%; any transparency is unknown.
- raw: the pixel's own value is the occupancy in percent, above 100 unknown; `negate` does not matter.

So does map_server of ROS 2 Navigation, whose code is the reference where its documentation is silent. An
`OccupancyMap` knows free, occupied and unknown cells only: what `scale` puts in between is unknown, and the
percentages of `raw` are compared with the two thresholds.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from agents.errors import DataError
from estimator.arrays import FloatArray
from estimator.maps.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyMap

Mode = Literal["trinary", "scale", "raw"]
MAX_PIXELS = 100_000_000  # 10,000 x 10,000: more is a wrong file rather than a map

_MODES: tuple[str, ...] = get_args(Mode)
_KNOWN = ("image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True)
class MapHeader:
    """What the YAML file says."""

    file: Path  # it itself
    image: Path
    resolution: float  # metres per pixel
    origin: FloatArray  # (3,) x, y, yaw of the image's lower left corner
    occupied: float  # threshold 0..1
    free: float
    mode: str
    negate: bool


def read_map(file: Path) -> OccupancyMap:
    """The map of a YAML file.

    Raises:
        DataError: if a file is missing or wrong; names it, and the key.
    """
    header = read_header(file)
    percent = occupancy(header)
    # In trinary and scale the thresholds have been applied: what lies beyond them is exactly 0 or 100.
    low, high = 100.0 * header.free, 100.0 * header.occupied
    low, high = (max(low, 1.0), min(high, 99.0)) if header.mode == "raw" else (1.0, 99.0)
    cells = np.full(percent.shape, UNKNOWN, dtype=np.uint8)
    cells[(percent >= 0) & (percent < low)] = FREE
    cells[percent > high] = OCCUPIED
    return OccupancyMap(cells, header.resolution, header.origin)


def read_header(file: Path) -> MapHeader:
    """The YAML file of a map.

    Raises:
        DataError: if it is missing or wrong; names the key.
    """
    import yaml  # noqa: PLC0415 - only missions with a map need it

    try:
        table = yaml.safe_load(file.read_bytes())
    except OSError as error:
        raise DataError(f"the map {file} cannot be read: {error.strerror or error}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f"{file} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(table, dict):
        raise DataError(f"{file}: expected the keys {', '.join(_KNOWN)}, found {_show(table)}")
    image = table.get("image")
    if not isinstance(image, str) or not image:
        raise DataError(f"{file}: image: expected the name of a picture, found {_show(image)}")
    mode = table.get("mode", "trinary")
    if mode not in _MODES:
        raise DataError(f"{file}: mode: expected one of {', '.join(_MODES)}, found {_show(mode)}")
    negate = table.get("negate")
    if not isinstance(negate, bool | int) or negate not in (0, 1):
        raise DataError(f"{file}: negate: expected 0 or 1, found {_show(negate)}")
    origin = table.get("origin")
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_is_finite, origin)):
        raise DataError(f"{file}: origin: expected 3 numbers x, y, yaw, found {_show(origin)}")
    resolution: Any = table.get("resolution")
    if not _is_finite(resolution) or resolution <= 0.0:
        raise DataError(f"{file}: resolution: expected a number > 0, found {_show(resolution)}")
    occupied, free = (_number(file, table, key, 0.0, 1.0) for key in ("occupied_thresh", "free_thresh"))
    if free >= occupied:
        allowed = f"a number below occupied_thresh, which is {occupied:g}"
        raise DataError(f"{file}: free_thresh: expected {allowed}, found {free:g}")
    place = np.array(origin, dtype=np.float64)
    return MapHeader(
        file, file.parent / image, float(resolution), place, occupied, free, str(mode), bool(negate)
    )


def occupancy(header: MapHeader) -> np.ndarray:
    """Percent occupied (rows, columns) as int16, -1 for unknown; the first row is the lowest of the map.

    Raises:
        DataError: if the image is missing or no image; names it.
    """
    try:
        shade, alpha = _pixels(header.image)
    except DataError as error:
        raise DataError(f"{header.file}: image: {error}") from None
    if header.mode == "raw":
        value = np.rint(shade * 255.0)
        percent = np.where(value <= 100.0, value, -1.0)
    else:
        if header.mode == "trinary" and alpha is not None:
            shade = (3.0 * shade + alpha) / 4.0
        dark = shade if header.negate else 1.0 - shade
        between = np.full(dark.shape, -1.0)
        if header.mode == "scale":
            share = (dark - header.free) / (header.occupied - header.free)
            between = np.rint(100.0 * np.clip(share, 0.0, 1.0))
        percent = np.where(dark > header.occupied, 100.0, np.where(dark < header.free, 0.0, between))
        if header.mode == "scale" and alpha is not None:
            percent[alpha < 1.0] = -1.0
    return np.ascontiguousarray(percent[::-1].astype(np.int16))


def _pixels(file: Path) -> tuple[np.ndarray, np.ndarray | None]:
    """Lightness 0..1 and opacity 0..1 (None: all opaque) of an image's pixels, both (rows, columns)."""
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 - as above

    try:
        with Image.open(file) as image:
            if image.width * image.height > MAX_PIXELS:
                raise DataError(f"{file} has {image.width} x {image.height} pixels: too many for a map")
            has_alpha = "A" in image.getbands() or "transparency" in image.info
            if image.mode.startswith("I"):  # 16 bits a pixel
                return np.asarray(image, dtype=np.float64) / 65535.0, None
            colours = np.asarray(image.convert("RGBA" if has_alpha else "RGB"), dtype=np.float64) / 255.0
    except FileNotFoundError:
        raise DataError(f"{file} does not exist") from None
    except (OSError, UnidentifiedImageError, ValueError, SyntaxError) as error:
        raise DataError(f"{file} cannot be read: {error}") from None
    return colours[:, :, :3].mean(axis=2), colours[:, :, 3] if has_alpha else None


def _number(file: Path, table: dict[Any, Any], key: str, low: float, high: float) -> float:
    value: Any = table.get(key)
    if not _is_finite(value) or not low <= value <= high:
        raise DataError(f"{file}: {key}: expected a number from {low:g} to {high:g}, found {_show(value)}")
    return float(value)


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _show(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
