#include "numpy_views.hpp"

namespace py = pybind11;

void bind_camera(py::module_&) {}
