// Encoded event streams as cameras send them: EVT 2, 2.1 and 3 of Prophesee, and the packets of libcaer.
// Sources: Prophesee, "Data encoding formats"; event_camera_msgs, "Encoding schemes".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

enum class EvtEncoding {
  evt2,
  evt21,
  evt21_swapped,  // "legacy": the two halves of each 64-bit word are exchanged
  evt3,
};

// Decodes a byte stream piece by piece, wherever the pieces are cut.  Words are little-endian.  Events are as
// encoded: neither sorted nor checked against a sensor.
class EvtDecoder {
 public:
  explicit EvtDecoder(EvtEncoding encoding) : encoding_(encoding) {}

  // The events of the next bytes; those before the first high part of a time have none, and are left out.
  EventColumns decode(std::span<const std::uint8_t> bytes);

  // Bytes of a word whose rest is still to come; at the end of a sound stream 0.
  std::size_t pending() const { return pending_size_; }

  // Where Prophesee's own tools let time begin, us: the first high part of a time in the stream; in EVT 3 the
  // one before it, as files that they have converted show.  0 before it is known.
  std::int64_t origin() const { return origin_; }

 private:
  template <typename Word>
  void decode_words(std::span<const std::uint8_t> bytes, EventColumns& events);
  void take(std::uint16_t word, EventColumns& events);
  void take(std::uint32_t word, EventColumns& events);
  void take(std::uint64_t word, EventColumns& events);
  void set_time_high(std::int64_t high, int high_bits, int low_bits);

  EvtEncoding encoding_;
  std::array<std::uint8_t, 8> pending_{};
  std::size_t pending_size_ = 0;
  bool has_time_ = false;
  std::int64_t high_ = 0;   // high part of the time as encoded
  std::int64_t wraps_ = 0;  // how often it has started from 0 again
  std::int64_t base_ = 0;   // both together, us
  std::int64_t origin_ = 0;
  std::int64_t low_ = 0;      // EVT 3: low part of the time, us
  std::uint16_t y_ = 0;       // EVT 3: row of the events to come
  std::uint16_t x_base_ = 0;  // EVT 3: first column of the next vector
  bool rise_ = false;         // EVT 3: polarity of vectors
};

// The events of one packet "libcaer_cmp" of event_camera_msgs; times count from the packet's time base.
// Throws std::invalid_argument at a word of no known kind, with its byte.
EventColumns decode_libcaer_packet(std::span<const std::uint8_t> bytes);

}  // namespace emseg
