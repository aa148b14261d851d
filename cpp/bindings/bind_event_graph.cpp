#include "numpy_views.hpp"

namespace py = pybind11;

void bind_event_graph(py::module_&) {}
