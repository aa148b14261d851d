#include "numpy_views.hpp"

namespace py = pybind11;

void bind_expansion(py::module_&) {}
