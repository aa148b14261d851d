#include <tuple>

#include "emseg/event_stream_decoder.hpp"
#include "emseg/evt_decoder.hpp"
#include "numpy_views.hpp"

namespace py = pybind11;
using namespace emseg;
using namespace emseg::bindings;

namespace {

using Columns = std::tuple<py::array_t<std::uint16_t>, py::array_t<std::uint16_t>, py::array_t<std::int64_t>,
                           py::array_t<std::uint8_t>>;

Columns columns_of(EventColumns&& events) {
  return {to_numpy(std::move(events.x)), to_numpy(std::move(events.y)), to_numpy(std::move(events.t)),
          to_numpy(std::move(events.p))};
}

// The columns that `decode` makes of the bytes, without Python's lock meanwhile.
template <typename Decode>
auto decoded(const Array<std::uint8_t>& bytes, const Decode& decode) {
  const std::span<const std::uint8_t> piece = view(bytes);
  EventColumns events;
  {
    py::gil_scoped_release release;
    events = decode(piece);
  }
  return columns_of(std::move(events));
}

}  // namespace

void bind_evt_decoder(py::module_& m) {
  py::enum_<EvtEncoding>(m, "EvtEncoding", "How a Prophesee stream is encoded.")
      .value("evt2", EvtEncoding::evt2)
      .value("evt21", EvtEncoding::evt21)
      .value("evt21_swapped", EvtEncoding::evt21_swapped)
      .value("evt3", EvtEncoding::evt3);
  py::class_<EvtDecoder>(m, "EvtDecoder", "Decodes a Prophesee byte stream piece by piece.")
      .def(py::init<EvtEncoding>(), py::arg("encoding"))
      .def(
          "decode",
          [](EvtDecoder& decoder, const Array<std::uint8_t>& bytes) {
            return decoded(bytes, [&](std::span<const std::uint8_t> piece) { return decoder.decode(piece); });
          },
          py::arg("bytes"), "Columns x, y, t (us), p of the events in the next bytes, uint8 (n,).")
      .def_property_readonly("pending", &EvtDecoder::pending, "Bytes of a word whose rest is still to come.")
      .def_property_readonly("origin", &EvtDecoder::origin,
                             "Where the maker's own tools let time begin, us.");
  m.def(
      "decode_libcaer_packet",
      [](const Array<std::uint8_t>& bytes) {
        return decoded(bytes,
                       [](std::span<const std::uint8_t> packet) { return decode_libcaer_packet(packet); });
      },
      py::arg("bytes"), "Columns x, y, t (us since the packet's time base), p of a packet `libcaer_cmp`.");
  py::enum_<EventStreamKind>(m, "EventStreamKind", "What an Event Stream file holds.")
      .value("dvs", EventStreamKind::dvs)
      .value("atis", EventStreamKind::atis);
  py::class_<EventStreamDecoder>(m, "EventStreamDecoder", "Decodes an Event Stream piece by piece.")
      .def(py::init<EventStreamKind>(), py::arg("kind"))
      .def(
          "decode",
          [](EventStreamDecoder& decoder, const Array<std::uint8_t>& bytes) {
            return decoded(bytes, [&](std::span<const std::uint8_t> piece) { return decoder.decode(piece); });
          },
          py::arg("bytes"), "Columns x, y, t (us), p of the events in the next bytes, uint8 (n,).")
      .def_property_readonly("pending", &EventStreamDecoder::pending,
                             "Bytes of an event whose rest is still to come.");
}
