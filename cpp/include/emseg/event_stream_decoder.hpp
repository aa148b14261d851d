// The Event Stream format (.es), version 2.  Source: "Event Stream specification", neuromorphicsystems.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "emseg/evt_decoder.hpp"

namespace emseg {

enum class EventStreamKind {
  dvs,
  atis,  // of which the change detections are decoded, not the exposure measurements
};

// Decodes the bytes after the header piece by piece, wherever the pieces are cut.
class EventStreamDecoder {
 public:
  explicit EventStreamDecoder(EventStreamKind kind) : kind_(kind) {}

  EventColumns decode(std::span<const std::uint8_t> bytes);

  // Bytes of an event whose rest is still to come; at the end of a sound stream 0.
  std::size_t pending() const { return pending_size_; }

 private:
  static constexpr std::size_t event_bytes = 5;

  // Advances the time where the byte is not an event's first; else says that it is one.
  bool begins_event(std::uint8_t byte);
  void take(std::span<const std::uint8_t, event_bytes> event, EventColumns& events);

  EventStreamKind kind_;
  std::int64_t t_ = 0;  // us
  std::array<std::uint8_t, event_bytes> pending_{};
  std::size_t pending_size_ = 0;
};

}  // namespace emseg
