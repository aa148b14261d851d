#include "emseg/band_expansion.hpp"
#include "emseg/event_graph.hpp"
#include "emseg/expansion.hpp"
#include "emseg/max_flow.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

void bind_max_flow(py::module_& m) {
  m.def(
      "max_flow",
      [](const Array<std::int32_t>& tail, const Array<std::int32_t>& head,
         const Array<std::int64_t>& capacity, const Array<std::int64_t>& reverse,
         const Array<std::int64_t>& source, const Array<std::int64_t>& sink) {
        const FlowGraph graph{view(tail),    view(head),   view(capacity),
                              view(reverse), view(source), view(sink)};
        MaxFlowResult result;
        {
          py::gil_scoped_release release;
          result = max_flow(graph);
        }
        return py::make_tuple(result.flow, to_numpy(std::move(result.sink_side)));
      },
      py::arg("tail"), py::arg("head"), py::arg("capacity"), py::arg("reverse"), py::arg("source"),
      py::arg("sink"),
      "Value of a maximum flow, and 1 for every node on the sink's side of the minimum cut.");
}

// The same functions for 32- and 64-bit costs, told apart by the arrays' type.
template <typename Cost>
void bind_labeling(py::module_& m) {
  m.def(
      "labeling_energy",
      [](std::int32_t label_count, const Array<Cost>& unary, const Array<std::int64_t>& indptr,
         const Array<std::int32_t>& indices, const Array<Cost>& weight, const Array<std::int64_t>& label_cost,
         const Array<std::int32_t>& labels) {
        const BasicLabelingProblem<Cost> problem{label_count,   view(unary),  view(indptr),
                                                 view(indices), view(weight), view(label_cost)};
        py::gil_scoped_release release;
        return labeling_energy(problem, view(labels));
      },
      py::arg("label_count"), py::arg("unary"), py::arg("indptr"), py::arg("indices"), py::arg("weight"),
      py::arg("label_cost"), py::arg("labels"), "Data, Potts and label costs of a labelling.");
  m.def(
      "expansion",
      [](std::int32_t label_count, const Array<Cost>& unary, const Array<std::int64_t>& indptr,
         const Array<std::int32_t>& indices, const Array<Cost>& weight, const Array<std::int64_t>& label_cost,
         const Array<std::int32_t>& initial, int max_sweeps) {
        const BasicLabelingProblem<Cost> problem{label_count,   view(unary),  view(indptr),
                                                 view(indices), view(weight), view(label_cost)};
        ExpansionResult result;
        {
          py::gil_scoped_release release;
          result = expansion(problem, view(initial), {.max_sweeps = max_sweeps});
        }
        return py::make_tuple(to_numpy(std::move(result.labels)), result.energy,
                              to_numpy(std::move(result.energy_trace)));
      },
      py::arg("label_count"), py::arg("unary"), py::arg("indptr"), py::arg("indices"), py::arg("weight"),
      py::arg("label_cost"), py::arg("initial"), py::arg("max_sweeps"),
      "Labels, energy, and the energy before the first sweep and after each; an empty initial starts from "
      "the\n"
      "cheapest labels.");
}

void bind_band_expansion(py::module_& m) {
  m.def(
      "band_expansion",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, int width, int height, const Array<std::int32_t>& unary,
         std::int32_t smooth_cost, const Array<std::int64_t>& label_cost,
         const Array<std::int32_t>& initial) {
        const EventView events = event_view(x, y, t, p);
        const std::size_t n = events.size();
        if (unary.ndim() != 2 || static_cast<std::size_t>(unary.shape(1)) != n) {
          throw std::invalid_argument("unary must have the shape (labels, events)");
        }
        std::vector<std::span<const std::int32_t>> costs;
        for (py::ssize_t l = 0; l < unary.shape(0); ++l) {
          costs.push_back(view(unary).subspan(static_cast<std::size_t>(l) * n, n));
        }
        ExpansionResult result;
        {
          py::gil_scoped_release release;
          const PixelGraph graph = build_pixel_graph(events, {width, height});
          ExpansionWorkspace workspace;
          BandExpansion bands(graph, workspace);
          result = bands.minimise({costs, smooth_cost, view(label_cost)}, view(initial));
        }
        return py::make_tuple(to_numpy(std::move(result.labels)), result.energy);
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("width"), py::arg("height"),
      py::arg("unary"), py::arg("smooth_cost"), py::arg("label_cost"), py::arg("initial"),
      "Labels of a window from coarse to fine, and their energy; unary is (labels, events).");
}

}  // namespace

void bind_expansion(py::module_& m) {
  bind_max_flow(m);
  bind_labeling<std::int32_t>(m);
  bind_labeling<std::int64_t>(m);
  bind_band_expansion(m);
}
