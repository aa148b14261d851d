#include "emseg/event_slices.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

void bind_event_slices(py::module_& m) {
  m.def(
      "event_slices",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, int width, int height, const Array<std::int64_t>& times,
         std::int64_t width_us, int shrink) {
        const EventView events = event_view(x, y, t, p);
        std::vector<std::uint8_t> images;
        {
          py::gil_scoped_release release;
          images = event_slices(events, {width, height}, view(times), {width_us, shrink});
        }
        return to_numpy(std::move(images),
                        {static_cast<py::ssize_t>(times.size()), 3, height / shrink, width / shrink});
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("width"), py::arg("height"),
      py::arg("times"), py::arg("width_us"), py::arg("shrink"),
      "Images of rises, mean time and falls around each time, uint8 (n, 3, height / shrink, width / "
      "shrink).");
}
