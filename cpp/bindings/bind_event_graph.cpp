#include "emseg/event_graph.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

std::pair<py::array_t<std::int64_t>, py::array_t<std::int32_t>> event_graph(const Array<std::uint16_t>& x,
                                                                            const Array<std::uint16_t>& y,
                                                                            const Array<std::int64_t>& t,
                                                                            const Array<std::uint8_t>& p,
                                                                            int width, int height) {
  const EventView events = event_view(x, y, t, p);
  EventGraph graph;
  {
    py::gil_scoped_release release;
    graph = build_event_graph(events, {width, height});
  }
  return {to_numpy(std::move(graph.indptr)), to_numpy(std::move(graph.indices))};
}

template <std::vector<PixelEdge> (*Triangulate)(std::span<const Pixel>)>
py::array_t<std::int32_t> triangulate(const Array<std::int32_t>& xy) {
  if (xy.ndim() != 2 || xy.shape(1) != 2) throw std::invalid_argument("pixels must have the shape (n, 2)");
  std::vector<std::int32_t> flat;
  {
    const std::span<const std::int32_t> values = view(xy);
    py::gil_scoped_release release;
    std::vector<Pixel> pixels;
    pixels.reserve(values.size() / 2);
    for (std::size_t k = 0; k < values.size(); k += 2) pixels.push_back({values[k], values[k + 1]});
    const std::vector<PixelEdge> edges = Triangulate(pixels);
    flat.reserve(2 * edges.size());
    for (const auto& [a, b] : edges) flat.insert(flat.end(), {a, b});
  }
  const auto count = static_cast<py::ssize_t>(flat.size() / 2);
  return to_numpy(std::move(flat), {count, 2});
}

}  // namespace

void bind_event_graph(py::module_& m) {
  m.def(
      "event_graph", &event_graph, py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("width"),
      py::arg("height"),
      "Space-time graph in compressed rows: indptr int64 (n + 1,), indices int32 (edges,), each edge once.");
  m.def("delaunay_edges", &triangulate<delaunay_edges>, py::arg("pixels"),
        "Edges int32 (m, 2) of a Delaunay triangulation of distinct pixels int32 (n, 2) given as x, y.");
  m.def("delaunay_edges_cgal", &triangulate<delaunay_edges_cgal>, py::arg("pixels"),
        "The same by CGAL: the oracle and the pace to beat.");
}
