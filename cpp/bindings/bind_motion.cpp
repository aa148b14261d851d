#include "numpy_views.hpp"

namespace py = pybind11;

void bind_motion(py::module_&) {}
