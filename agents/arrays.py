"""`read_arrays`: the arrays of an ``.npz`` archive, with all sizes known before anything is unpacked."""

import ast
import zipfile
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 2**28  # bytes that a model's arrays may have


def read_arrays(content: bytes, *, limit: int = LARGEST) -> dict[str, NDArray[Any]]:
    """Arrays of numbers or strings by their names; never unpickles.

    Raises ``ValueError`` where the content is no such archive, is damaged, or unpacks to more bytes than the limit.
    """
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = archive.infolist()
            total = sum(each.file_size for each in entries)
            if total > limit:
                raise ValueError(f"it unpacks to {total} bytes, more than the {limit} that are read here")
            return {each.filename.removesuffix(".npy"): _array(archive.read(each)) for each in entries}
    except Exception as error:  # an archive that is made to harm may raise anything
        raise ValueError(f"it is not a whole npz archive of plain arrays: {error}") from None


def _array(content: bytes) -> NDArray[Any]:
    """Array in the content of an ``.npy`` file, which must be as long as its header says."""
    if content[:8] != b"\x93NUMPY\x01\x00":
        raise ValueError("a member is not an array")
    end = 10 + int.from_bytes(content[8:10], "little")
    header = ast.literal_eval(content[10:end].decode("latin1"))
    kind, shape = np.dtype(header["descr"]), header["shape"]
    if kind.hasobject:
        raise ValueError("a member holds pickled objects, which are never read")
    if prod(shape) * kind.itemsize != len(content) - end:
        raise ValueError(f"a member has {len(content) - end} bytes, not those of {kind} of shape {shape}")
    return np.lib.format.read_array(BytesIO(content), allow_pickle=False)
