#include "emseg/window.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

void bind_event(py::module_& m) {
  m.def(
      "check_events",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, int width, int height) {
        const EventView events = event_view(x, y, t, p);
        py::gil_scoped_release release;
        check_events(events, {width, height});
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("width"), py::arg("height"),
      "Raise ValueError at the first event out of order, off the sensor or with a wrong polarity.");
}
