#include <pybind11/pybind11.h>

namespace py = pybind11;

// One register function per stage, each in its bind_<stage>.cpp.
void bind_event(py::module_& m);
void bind_camera(py::module_& m);
void bind_event_filter(py::module_& m);
void bind_event_graph(py::module_& m);
void bind_event_slices(py::module_& m);
void bind_evt_decoder(py::module_& m);
void bind_expansion(py::module_& m);
void bind_motion(py::module_& m);
void bind_parts(py::module_& m);
void bind_segmenter(py::module_& m);
void bind_simulation(py::module_& m);

PYBIND11_MODULE(_core, m) {
  m.doc() = "The native core of emseg; the public surface is the emseg package.";
  m.attr("version") = EMSEG_VERSION;
  bind_event(m);
  bind_camera(m);
  bind_event_filter(m);
  bind_event_graph(m);
  bind_event_slices(m);
  bind_evt_decoder(m);
  bind_expansion(m);
  bind_motion(m);
  bind_parts(m);
  bind_segmenter(m);
  bind_simulation(m);
}
