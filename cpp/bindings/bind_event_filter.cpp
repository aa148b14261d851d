#include "emseg/event_filter.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

void bind_event_filter(py::module_& m) {
  py::class_<BackgroundActivityFilter>(m, "BackgroundActivityFilter",
                                       "Keeps events with a neighbour not long before them.")
      .def(py::init([](int width, int height, std::int64_t duration_us) {
             return BackgroundActivityFilter({width, height}, duration_us);
           }),
           py::arg("width"), py::arg("height"), py::arg("duration_us"))
      .def(
          "keep",
          [](BackgroundActivityFilter& filter, const Array<std::uint16_t>& x, const Array<std::uint16_t>& y,
             const Array<std::int64_t>& t, const Array<std::uint8_t>& p) {
            const EventView events = event_view(x, y, t, p);
            std::vector<std::uint8_t> kept;
            {
              py::gil_scoped_release release;
              kept = filter.keep(events);
            }
            return to_numpy(std::move(kept));
          },
          py::arg("x"), py::arg("y"), py::arg("t"), py::arg("p"),
          "1 for each event of the next chunk that is to stay, else 0, uint8 (n,).");
}
