"""The classical method in plain NumPy, SciPy, PyMaxflow and numba: slow, obvious, without the native engine.

Read `segment` first; it calls, in this order, `graph`, `pool` (through `search` and `fit`), `energy` and
`expansion`. Tests and benchmarks hold the engine against it.  Needs the extra `reference`.
"""

from emseg.reference.camera import Camera, undistortion_table
from emseg.reference.contrast import CONTRASTS, gradient_magnitude, mean_square, variance
from emseg.reference.energy import data_costs, labeling_energy, unary_costs
from emseg.reference.expansion import ExpansionResult, expansion, expansion_move
from emseg.reference.fit import FitOptions, fit_motion, refine
from emseg.reference.graph import EventGraph, build_event_graph, delaunay_edges, graph_of_edges
from emseg.reference.iwe import bilinear_lookup, bilinear_votes, blur, iwe
from emseg.reference.pool import model_pool, sub_volumes
from emseg.reference.search import SearchOptions, search
from emseg.reference.segment import Segmentation, SegmentOptions, segment
from emseg.reference.warp import DEGREES_OF_FREEDOM, MotionModel, warp, warp_points
from emseg.reference.window import ImageFrame, Region, Window, make_window

__all__ = [
    "CONTRASTS",
    "DEGREES_OF_FREEDOM",
    "Camera",
    "EventGraph",
    "ExpansionResult",
    "FitOptions",
    "ImageFrame",
    "MotionModel",
    "Region",
    "SearchOptions",
    "SegmentOptions",
    "Segmentation",
    "Window",
    "bilinear_lookup",
    "bilinear_votes",
    "blur",
    "build_event_graph",
    "data_costs",
    "delaunay_edges",
    "expansion",
    "expansion_move",
    "fit_motion",
    "gradient_magnitude",
    "graph_of_edges",
    "iwe",
    "labeling_energy",
    "make_window",
    "mean_square",
    "model_pool",
    "refine",
    "search",
    "segment",
    "sub_volumes",
    "unary_costs",
    "undistortion_table",
    "variance",
    "warp",
    "warp_points",
]
