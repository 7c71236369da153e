"""Palette PNG encoder for small images in HTML."""

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["encode_png", "png_data_url"]


def encode_png(pixels: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """Encode a PNG from `pixels` (height, width), indices into `palette` (n, 3)."""
    height, width = pixels.shape
    lines = np.zeros((height, width + 1), dtype=np.uint8)  # each line begins with its filter type, none
    lines[:, 1:] = pixels
    head = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    chunks = (
        (b"IHDR", head),
        (b"PLTE", palette.astype(np.uint8).tobytes()),
        (b"IDAT", zlib.compress(lines.tobytes(), 1)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        for name, body in chunks
    )


def png_data_url(pixels: NDArray[np.uint8], palette: NDArray[np.uint8]) -> str:
    """Data URL of the PNG, for HTML."""
    return "data:image/png;base64," + base64.b64encode(encode_png(pixels, palette)).decode()
