"""Pictures in notebooks: what the extension draws as HTML. They need no other library."""

from __future__ import annotations

import base64
import html
import struct
import zlib
from typing import TYPE_CHECKING, Optional

from tesserae_mesh._errors import Error

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from tesserae_mesh import _native

DENSITY = 1.5
"""Pixels of the picture for each pixel of the page."""


def with_picture(text: str, geometry: _native.Geometry, labels: Optional[NDArray[np.uint32]]) -> str:
    """Return a text below a picture of the clusters, of the faces without labels; only the text if there is none."""
    line = f"<code>{html.escape(text)}</code>"
    try:
        pixels = geometry.picture(labels)
    except Error as error:
        return f"<div>{line}<br>{html.escape(str(error))}</div>"
    height, width, _ = pixels.shape
    source = base64.b64encode(png(pixels)).decode()
    size = f'width="{width / DENSITY:.0f}" height="{height / DENSITY:.0f}"'
    return f'<div><img {size} alt="{html.escape(text)}" src="data:image/png;base64,{source}"><br>{line}</div>'


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Return rows of pixels, each red, green, blue and opacity, as a PNG."""
    height, width, _ = pixels.shape
    # each row as its difference from the one above (filter 2), which packs better
    rows = pixels.reshape(height, -1).copy()
    rows[1:] -= pixels.reshape(height, -1)[:-1]
    data = b"".join(b"\x02" + row.tobytes() for row in rows)

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(data, 6)) + chunk(b"IEND", b"")
