#include "numpy_views.hpp"

namespace py = pybind11;

void bind_segmenter(py::module_&) {}
