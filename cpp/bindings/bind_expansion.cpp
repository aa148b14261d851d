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
      [](const Array<std::int32_t>& tail, const Array<std::int32_t>& head, const Array<std::int64_t>& capacity,
         const Array<std::int64_t>& reverse, const Array<std::int64_t>& source,
         const Array<std::int64_t>& sink) {
        const FlowGraph graph{view(tail), view(head), view(capacity), view(reverse), view(source), view(sink)};
        MaxFlowResult result;
        {
          py::gil_scoped_release release;
          result = max_flow(graph);
        }
        return py::make_tuple(result.flow, to_numpy(std::move(result.sink_side)));
      },
      py::arg("tail"), py::arg("head"), py::arg("capacity"), py::arg("reverse"), py::arg("source"),
      py::arg("sink"), "Value of a maximum flow, and 1 for every node on the sink's side of the minimum cut.");
}

}  // namespace

void bind_expansion(py::module_& m) { bind_max_flow(m); }
