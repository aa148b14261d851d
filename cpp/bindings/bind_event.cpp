#include "emseg/window.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

py::array_t<std::int64_t> bounds_of(const std::vector<Window>& windows) {
  std::vector<std::int64_t> bounds;
  bounds.reserve(2 * windows.size());
  for (const Window& window : windows) {
    bounds.push_back(static_cast<std::int64_t>(window.begin));
    bounds.push_back(static_cast<std::int64_t>(window.end));
  }
  return to_numpy(std::move(bounds), {static_cast<py::ssize_t>(windows.size()), 2});
}

}  // namespace

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
  m.def(
      "take_events",
      [](const Array<std::uint16_t>& x, const Array<std::uint16_t>& y, const Array<std::int64_t>& t,
         const Array<std::uint8_t>& p, const Array<std::int64_t>& positions) {
        EventColumns taken = take_events(event_view(x, y, t, p), view(positions));
        return py::make_tuple(to_numpy(std::move(taken.x)), to_numpy(std::move(taken.y)),
                              to_numpy(std::move(taken.t)), to_numpy(std::move(taken.p)));
      },
      py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"), py::arg("positions"),
      "Columns x, y, t and p of the events at rising positions. Raise IndexError or ValueError at the first "
      "wrong one.");
  m.def(
      "windows_by_count",
      [](std::size_t event_count, std::size_t count) {
        return bounds_of(windows_by_count(event_count, count));
      },
      py::arg("event_count"), py::arg("count"),
      "Bounds int64 (k, 2) of successive windows of `count` events; the last holds the rest.");
  m.def(
      "windows_by_duration",
      [](const Array<std::int64_t>& t, std::int64_t duration_us) {
        const std::span<const std::int64_t> times = view(t);
        std::vector<Window> windows;
        {
          py::gil_scoped_release release;
          windows = windows_by_duration(times, duration_us);
        }
        return bounds_of(windows);
      },
      py::arg("t"), py::arg("duration_us"),
      "Bounds int64 (k, 2) of the windows [t0 + k d, t0 + (k+1) d) that hold events.");
}
