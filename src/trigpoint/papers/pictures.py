"""Grey pictures: one that the program draws itself, and the user's own from a PGM, PNG or NPY file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from trigpoint.arrays import FloatArray
from trigpoint.errors import ArgumentError, FileFormatError, MissingExtraError

SIZE = (70, 128)
WHITE = 255.0
_BETWEEN = rb"(?:\s|#[^\n]*\n)+"
_HEADER = re.compile(rb"(P[25])" + 3 * (_BETWEEN + rb"(\d+)") + rb"\s")


def night_scene(rows: int = SIZE[0], columns: int = SIZE[1], seed: int = 0) -> FloatArray:
    """A dark street with a lit window front, a lamp and grain; (rows, columns) of grey levels 0..255.

    Args: ``seed`` of the grain.
    """
    y, x = np.mgrid[0:rows, 0:columns] / np.array([rows, columns]).reshape(2, 1, 1)
    picture = 25.0 + 45.0 * y + 15.0 * x
    picture[(y > 0.28) & (y < 0.62) & (x > 0.3)] = 190.0
    picture[(y > 0.34) & (y < 0.56) & (x > 0.34) & (np.mod(x, 0.16) > 0.02)] = 235.0
    picture[(y > 0.62) & (y < 0.7) & (x > 0.26)] = 30.0
    for place, height in ((0.45, 0.42), (0.56, 0.45), (0.78, 0.43)):
        head = ((x - place) * columns / rows) ** 2 + (y - height) ** 2 < 0.035**2
        body = (np.abs(x - place) < 0.028) & (y > height + 0.03) & (y < 0.62)
        picture[head | body] = 25.0
    picture[(y > 0.05) & (y < 0.22) & (x < 0.25) & (np.mod(x, 0.06) > 0.025)] = 15.0
    picture += 60.0 * np.exp(-(((x - 0.12) * columns / rows) ** 2 + (y - 0.5) ** 2) / 0.01)
    picture += np.random.default_rng(seed).normal(0.0, 4.0, picture.shape)
    return np.asarray(np.clip(picture, 0.0, WHITE))


def read_picture(path: str | Path, size: tuple[int, int] = SIZE) -> FloatArray:
    """The grey levels 0..255 of a .pgm, .png or .npy file, averaged down (or spread) to ``size`` (rows, columns).

    Colours become their luminance; a table of .npy that exceeds 255 or is negative is refused.

    Raises:
        FileFormatError: the file cannot be read as a picture.
        MissingExtraError: a .png without matplotlib.

    Args: ``path``.
    """
    place = Path(path)
    kind = place.suffix.lower()
    readers = {".pgm": _pgm, ".png": _png, ".npy": _npy}
    if kind not in readers:
        raise FileFormatError(path, "is no picture that can be read; expected a name ending in .pgm, .png or .npy")
    if not place.is_file():
        raise FileFormatError(path, "there is no such file; check the name and the folder")
    return _resized(readers[kind](place), size)


def _pgm(path: Path) -> FloatArray:
    data = path.read_bytes()
    head = _HEADER.match(data)
    if head is None:
        raise FileFormatError(path, "is no PGM picture; expected P2 or P5, then width, height and the greatest value")
    kind, position = head.group(1), head.end()
    width, height, top = (int(word) for word in head.groups()[1:])
    if not (width > 0 and height > 0 and 0 < top < 65536):
        raise FileFormatError(path, f"has the size {width} x {height} and greatest value {top}; all must be positive")
    if kind == b"P2":
        rest = data[position:].split()
        numbers = np.array([int(word) for word in rest if word.isdigit()], dtype=float)
        if len(rest) != numbers.shape[0]:
            raise FileFormatError(path, "holds something other than whole numbers after its header")
    else:
        numbers = np.frombuffer(data[position:], dtype=np.uint8 if top < 256 else ">u2").astype(float)
    if numbers.shape[0] < width * height:
        raise FileFormatError(path, f"ends after {numbers.shape[0]} of {width * height} grey values")
    return np.asarray(numbers[: width * height].reshape(height, width) * (WHITE / top))


def _png(path: Path) -> FloatArray:
    try:
        from matplotlib.image import imread
    except ImportError as error:
        raise MissingExtraError("matplotlib", "report", "reading a PNG picture") from error
    try:
        table = np.asarray(imread(path, format="png"), dtype=float)
    except (OSError, SyntaxError, ValueError) as error:
        raise FileFormatError(path, f"is no PNG picture ({error})") from error
    if table.ndim == 3:
        table = table[:, :, :3] @ [0.299, 0.587, 0.114] if table.shape[2] >= 3 else table[:, :, 0]
    return np.asarray(table * WHITE)


def _npy(path: Path) -> FloatArray:
    try:
        table = np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise FileFormatError(path, f"is no table of numbers ({error})") from error
    if table.ndim != 2 or table.dtype.kind not in "buif" or not table.size:
        raise FileFormatError(path, f"must hold a table (rows, columns) of numbers; got {table.dtype} {table.shape}")
    levels = table.astype(float)
    if not (np.isfinite(levels).all() and levels.min() >= 0.0 and levels.max() <= WHITE):
        raise FileFormatError(path, f"has grey levels outside 0..255: {levels.min():g} to {levels.max():g}")
    return levels


def _resized(table: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Mean of the part of the picture that each new pixel covers."""
    if min(size) < 1:
        raise ArgumentError(f"size must be at least one row and one column; got {size}")
    return np.asarray(np.clip(_averaged(_averaged(table, size[0]).T, size[1]).T, 0.0, WHITE))


def _averaged(table: FloatArray, count: int) -> FloatArray:
    """``count`` rows in place of the table's own: differences of the running sum at the new edges."""
    old = table.shape[0]
    sums = np.concatenate([np.zeros_like(table[:1]), np.cumsum(table, axis=0)])
    edges = np.linspace(0.0, old, count + 1)
    whole = np.minimum(edges.astype(int), old - 1)
    share = (edges - whole)[:, None]
    at = (1.0 - share) * sums[whole] + share * sums[whole + 1]
    return np.asarray(np.diff(at, axis=0) * (count / old))
