"""Problems for the cut benchmarks: space-time graphs over events, and the published data term."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay

IntArray = NDArray[np.int64]


def space_time_edges(x: IntArray, y: IntArray, t: NDArray[np.float64]) -> IntArray:
    """Edges (m, 2), i < j, to the temporal neighbours at the own and at Delaunay-neighbour pixels."""
    n = len(x)
    pixel_code, pixel = np.unique(y.astype(np.int64) * 65536 + x, return_inverse=True)
    triangles = Delaunay(np.column_stack([pixel_code % 65536, pixel_code // 65536])).simplices
    joined = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    joined = np.unique(np.vstack([joined, joined[:, ::-1]]), axis=0)

    rank = np.empty(n, np.int64)  # place in time
    rank[np.argsort(t, kind="stable")] = np.arange(n)
    key = pixel.astype(np.int64) * n + rank
    order = np.argsort(key)
    sorted_key = key[order]

    same = pixel[order][1:] == pixel[order][:-1]
    pairs = [np.column_stack([order[:-1], order[1:]])[same]]
    row_start = np.searchsorted(joined[:, 0], np.arange(len(pixel_code) + 1))
    degree = np.diff(row_start)[pixel]
    event = np.repeat(np.arange(n), degree)
    slot = np.arange(len(event)) - np.repeat(np.cumsum(degree) - degree, degree)
    there = joined[row_start[pixel[event]] + slot, 1]
    after = np.searchsorted(sorted_key, there * n + rank[event])
    for place in (after - 1, after):
        inside = (place >= 0) & (place < n)
        found = order[place[inside]]
        keep = pixel[found] == there[inside]
        pairs.append(np.column_stack([event[inside][keep], found[keep]]))
    return np.unique(np.sort(np.vstack(pairs), axis=1), axis=0)


def rows_of(edges: IntArray, n: int) -> tuple[IntArray, NDArray[np.int32]]:
    """Compressed rows (indptr, indices) of edges sorted by their first end."""
    indptr = np.searchsorted(edges[:, 0], np.arange(n + 1)).astype(np.int64)
    return indptr, edges[:, 1].astype(np.int32)


def published_unary(
    x: IntArray, y: IntArray, t: NDArray[np.float64], models: NDArray[np.float64], width: int, height: int
) -> NDArray[np.int32]:
    """255 (1 - IWE_m / max) for models (tx, ty, s, theta) about the image's origin; shape (n, models)."""
    dt = t - t[0]
    images, places = [], []
    for tx, ty, s, theta in models:
        c, sn = (1 + s) * np.cos(theta) - 1, (1 + s) * np.sin(theta)
        u = x - dt * (tx + c * x - sn * y)
        v = y - dt * (ty + sn * x + c * y)
        image = np.zeros((height + 2, width + 2))
        u0, v0 = np.floor(u).astype(int), np.floor(v).astype(int)
        inside = (u0 >= 0) & (u0 < width - 1) & (v0 >= 0) & (v0 < height - 1)
        fu, fv = u - u0, v - v0
        for du, dv, weight in (
            (0, 0, (1 - fu) * (1 - fv)), (1, 0, fu * (1 - fv)), (0, 1, (1 - fu) * fv), (1, 1, fu * fv)
        ):  # fmt: skip
            np.add.at(image, (v0[inside] + dv, u0[inside] + du), weight[inside])
        images.append(gaussian_filter(image, 1.0))
        row, column = np.clip(np.round(v).astype(int), 0, height), np.clip(np.round(u).astype(int), 0, width)
        places.append((row, column))
    top = max(image.max() for image in images)
    columns = [255 * (1 - image[place] / top) for image, place in zip(images, places, strict=True)]
    return np.round(np.column_stack(columns)).astype(np.int32)


def made_events(n: int, width: int, height: int, seed: int) -> tuple[IntArray, IntArray, NDArray[np.float64]]:
    """Events of drifting edges: short tracks of pixels that fire a few times each, plus noise."""
    rng = np.random.default_rng(seed)
    edges = 240
    edge = rng.integers(0, edges, n)
    along = rng.uniform(0, 60, n)
    angle = rng.uniform(0, np.pi, edges)[edge]
    speed = rng.normal(0, 150, (edges, 2))[edge]
    t = np.sort(rng.uniform(0, 0.05, n))
    x = rng.uniform(0, width, edges)[edge] + along * np.cos(angle) + speed[:, 0] * t + rng.normal(0, 0.7, n)
    y = rng.uniform(0, height, edges)[edge] + along * np.sin(angle) + speed[:, 1] * t + rng.normal(0, 0.7, n)
    return np.mod(np.round(x), width).astype(np.int64), np.mod(np.round(y), height).astype(np.int64), t
