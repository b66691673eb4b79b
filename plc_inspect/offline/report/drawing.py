# Copyright 2026 plc_inspect contributors
# SPDX-License-Identifier: Apache-2.0

"""Small SVG drawings and PNG images for the report, without a plotting library."""

import base64
from collections.abc import Iterable, Sequence
from html import escape
import math
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from plc_inspect.results import Float64, UInt8

Range = tuple[float, float]


def encode_png(indices: UInt8, palette: Sequence[str]) -> bytes:
    """
    Encode an image of palette indices as PNG.

    Parameters
    ----------
    indices : (H, W) uint8
        Index into the palette; 0 is transparent.
    palette : sequence of str
        Colours as ``#rrggbb``; the first is not used.

    Returns
    -------
    The bytes of the file.

    """
    height, width = indices.shape
    colors = b''.join(bytes.fromhex(color[1:]) for color in palette)
    rows = np.zeros((height, width + 1), np.uint8)
    rows[:, 1:] = indices
    chunks = (
        (b'IHDR', struct.pack('>IIBBBBB', width, height, 8, 3, 0, 0, 0)),
        (b'PLTE', colors),
        (b'tRNS', b'\0'),
        (b'IDAT', zlib.compress(rows.tobytes(), 4)),
        (b'IEND', b''),
    )
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))
        for kind, data in chunks
    )


def choose_ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most ``most`` round numbers within [low, high], equally spaced."""
    if not high > low:
        return [low]
    raw = (high - low) / max(most - 1, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999999)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [index * step for index in range(first, last + 1)]


def format_tick(value: float, step: float) -> str:
    """Return a number with the decimals that steps of ``step`` need."""
    decimals = max(0, -math.floor(math.log10(step) + 1e-9)) if step > 0 else 0
    return f'{value:.{decimals}f}'.replace('-', '\u2212')


class Plot:
    """
    One drawing with an x and a y axis; y grows upwards.

    Everything is drawn in data coordinates; texts and strokes are in pixels of the page.
    """

    def __init__(
        self, x_range: Range, y_range: Range, size: tuple[int, int], title: str, *,
        margins: tuple[int, int, int, int] = (10, 12, 40, 56),
    ) -> None:
        """
        Make an empty drawing.

        Parameters
        ----------
        x_range, y_range : (low, high)
            Extent of the frame in data coordinates.
        size : (width, height)
            Size of the whole drawing [px].
        title : str
            Text alternative of the drawing.
        margins : (top, right, bottom, left)
            Room around the frame [px].

        """
        top, right, bottom, left = margins
        self.x_range, self.y_range, self.size, self.title = x_range, y_range, size, title
        self.left, self.top = left, top
        self.width, self.height = size[0] - left - right, size[1] - top - bottom
        self._inside: list[str] = []
        self._outside: list[str] = []

    def to_pixels(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return the pixel coordinates of data coordinates, arrays of one shape."""
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        px = self.left + (np.asarray(x, np.float64) - x0) * (self.width / (x1 - x0))
        py = self.top + (y1 - np.asarray(y, np.float64)) * (self.height / (y1 - y0))
        return px, py

    def add_points(
        self, x: Float64, y: Float64, color: UInt8, palette: Sequence[str], *,
        resolution: float = 1.5, size: int = 2, fill: int = 0,
    ) -> None:
        """
        Draw points as an image below everything else; later points hide earlier ones.

        Parameters
        ----------
        x, y : (N,) float64
            Data coordinates; points outside the frame are left out.
        color : (N,) uint8
            Index into the palette, from 1.
        palette : sequence of str
            Colours as ``#rrggbb``; the first is not used.
        resolution : float
            Pixels of the image per pixel of the page.
        size : int
            Edge of a point [px of the image].
        fill : int
            How many pixels wide gaps between points may be to be closed.

        """
        width, height = round(self.width * resolution), round(self.height * resolution)
        px, py = self.to_pixels(x, y)
        column = np.floor((px - self.left) * resolution).astype(np.int64)
        row = np.floor((py - self.top) * resolution).astype(np.int64)
        image = np.zeros((height + size, width + size), np.uint8)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        column, row, color = column[inside], row[inside], color[inside]
        for right in range(size):
            for down in range(size):
                image[row + down, column + right] = color
        image = _close_gaps(image[:height, :width], fill)
        data = base64.b64encode(encode_png(image, palette)).decode('ascii')
        self._inside.append(
            f'<image x="{self.left}" y="{self.top}" width="{self.width}" height="{self.height}"'
            f' preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'
        )

    def add_line(self, x: Float64, y: Float64, style: str, label: str = '') -> None:
        """Draw a polyline; ``style`` is a CSS class, ``label`` is shown under the pointer."""
        px, py = self.to_pixels(x, y)
        path = ' '.join(f'{a:.1f},{b:.1f}' for a, b in zip(px, py, strict=True))
        self._inside.append(f'<polyline points="{path}" {_style(style)}>{_hint(label)}</polyline>')

    def add_circle(
        self, x: float, y: float, radius: float, style: str, label: str = '', *,
        in_data: bool = False,
    ) -> None:
        """Draw a circle; the radius is in pixels, or in x data units with ``in_data``."""
        px, py = self.to_pixels(np.array(x), np.array(y))
        if in_data:
            radius *= self.width / (self.x_range[1] - self.x_range[0])
        self._inside.append(
            f'<circle cx="{px:.1f}" cy="{py:.1f}" r="{radius:.1f}" {_style(style)}>'
            f'{_hint(label)}</circle>'
        )

    def add_square(self, x: float, y: float, edge: float, style: str, label: str = '') -> None:
        """Draw a square around a point; the edge is in pixels."""
        px, py = self.to_pixels(np.array(x), np.array(y))
        self._inside.append(
            f'<rect x="{px - edge / 2:.1f}" y="{py - edge / 2:.1f}" width="{edge:.1f}"'
            f' height="{edge:.1f}" {_style(style)}>{_hint(label)}</rect>'
        )

    def add_text(
        self, x: float, y: float, text: str, style: str = '', *, dx: float = 0.0, dy: float = 0.0
    ) -> None:
        """Write a text at a point, moved by (dx, dy) pixels."""
        px, py = self.to_pixels(np.array(x), np.array(y))
        self._inside.append(
            f'<text x="{px + dx:.1f}" y="{py + dy:.1f}" {_style(style)}>{escape(text)}</text>'
        )

    def add_axes(self, x_label: str, y_label: str, *, grid: bool = True) -> None:
        """Draw frame, ticks, grid and the names of both axes."""
        left, top, width, height = self.left, self.top, self.width, self.height
        lines = []
        for values, horizontal in (
            (choose_ticks(*self.x_range, max(2, width // 75)), True),
            (choose_ticks(*self.y_range, max(2, height // 42)), False),
        ):
            step = values[1] - values[0] if len(values) > 1 else 1.0
            for value in values:
                text = format_tick(value, step)
                px, py = self.to_pixels(np.array(value), np.array(value))
                if horizontal:
                    lines.append(f'M{px:.1f} {top}v{height}')
                    place = f'class="tick mid" x="{px:.1f}" y="{top + height + 15}"'
                else:
                    lines.append(f'M{left} {py:.1f}h{width}')
                    place = f'class="tick end" x="{left - 6}" y="{py + 4:.1f}"'
                self._outside.append(f'<text {place}>{text}</text>')
        if grid:
            self._outside.append(f'<path class="grid" d="{"".join(lines)}"/>')
        self._outside.append(
            f'<rect class="frame" x="{left}" y="{top}" width="{width}" height="{height}"/>'
        )
        middle = top + height / 2
        self._outside.append(
            f'<text class="axis mid" x="{left + width / 2:.0f}" y="{self.size[1] - 6}">'
            f'{escape(x_label)}</text><text class="axis mid" x="13" y="{middle:.0f}"'
            f' transform="rotate(-90 13 {middle:.0f})">{escape(y_label)}</text>'
        )

    def add_scale_bar(self, unit: str) -> None:
        """Draw a bar of a round length in the lower left corner."""
        span = self.x_range[1] - self.x_range[0]
        power = 10.0 ** math.floor(math.log10(span / 4))
        length = max(factor * power for factor in (1, 2, 5) if factor * power <= span / 4)
        pixels = length * self.width / span
        x, y = self.left + 14, self.top + self.height - 14
        self._outside.append(
            f'<path class="scale" d="M{x} {y - 5}v5h{pixels:.1f}v-5"/>'
            f'<text class="tick" x="{x + pixels + 6:.1f}" y="{y}">{length:g} {unit}</text>'
        )

    def render(self, identity: str) -> str:
        """Return the SVG element; ``identity`` must differ between drawings of a page."""
        width, height = self.size
        clip = (
            f'<clipPath id="{identity}"><rect x="{self.left}" y="{self.top}"'
            f' width="{self.width}" height="{self.height}"/></clipPath>'
        )
        images = [item for item in self._inside if item.startswith('<image')]
        others = [item for item in self._inside if not item.startswith('<image')]
        return (
            f'<svg viewBox="0 0 {width} {height}" width="{width}" role="img">'
            f'<title>{escape(self.title)}</title>{clip}'
            f'<g clip-path="url(#{identity})">{"".join(images)}</g>{"".join(self._outside)}'
            f'<g clip-path="url(#{identity})">{"".join(others)}</g></svg>'
        )


def draw_bars(values: Iterable[float], title: str, size: tuple[int, int] = (220, 36)) -> str:
    """
    Return a small bar chart without axes, for a histogram within a table.

    If one bar dwarfs all others, heights are logarithmic, which the title says.
    """
    heights = np.array([value if math.isfinite(value) else 0.0 for value in values])
    heights = np.maximum(heights, 0.0)
    filled = heights[heights > 0]
    if len(filled) and filled.max() > 50.0 * np.median(filled):
        heights, title = np.log1p(heights), f'{title}, logarithmic'
    top = heights.max(initial=0.0) or 1.0
    width = size[0] / max(len(heights), 1)
    path = ''.join(
        f'M{index * width:.1f} {size[1]}v{-size[1] * value / top:.1f}h{width:.1f}'
        f'V{size[1]}'
        for index, value in enumerate(heights)
    )
    return (
        f'<svg class="bars" viewBox="0 0 {size[0]} {size[1]}" width="{size[0]}"'
        f' height="{size[1]}" role="img"><title>{escape(title)}</title><path d="{path}"/></svg>'
    )


def _close_gaps(image: UInt8, gap: int) -> UInt8:
    """Fill empty pixels with the colour of a neighbour, ``gap`` times."""
    for _ in range(gap):
        padded = np.pad(image, 1)
        for neighbor in (padded[1:-1, :-2], padded[1:-1, 2:], padded[:-2, 1:-1], padded[2:, 1:-1]):
            image = np.where(image == 0, neighbor, image)
    return image


def _style(style: str) -> str:
    """Return a class attribute, with a colour where the style ends in ``#rrggbb``."""
    name, hash_sign, color = style.partition('#')
    return f'class="{name.strip()}"' + (f' style="--c:#{color}"' if hash_sign else '')


def _hint(label: str) -> str:
    return f'<title>{escape(label)}</title>' if label else ''


def blend(first: str, second: str, count: int) -> list[str]:
    """Return ``count`` colours from the first to the second, as ``#rrggbb``."""
    ends = np.array([[int(color[i : i + 2], 16) for i in (1, 3, 5)] for color in (first, second)])
    shares: NDArray[np.float64] = np.linspace(0.0, 1.0, count)[:, np.newaxis]
    mixed = np.rint(ends[0] * (1 - shares) + ends[1] * shares).astype(int)
    return [f'#{red:02x}{green:02x}{blue:02x}' for red, green, blue in mixed.tolist()]
