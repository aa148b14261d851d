#include "emseg/event_stream_decoder.hpp"

#include <algorithm>

namespace emseg {

EventColumns EventStreamDecoder::decode(std::span<const std::uint8_t> bytes) {
  EventColumns events;
  const std::size_t expected = bytes.size() / event_bytes + 1;
  events.x.reserve(expected);
  events.y.reserve(expected);
  events.t.reserve(expected);
  events.p.reserve(expected);
  if (pending_size_ > 0) {
    const std::size_t missing = std::min(event_bytes - pending_size_, bytes.size());
    std::copy_n(bytes.data(), missing, pending_.data() + pending_size_);
    pending_size_ += missing;
    bytes = bytes.subspan(missing);
    if (pending_size_ < event_bytes) return events;
    take(pending_, events);
    pending_size_ = 0;
  }
  for (std::size_t k = 0; k < bytes.size();) {
    if (!begins_event(bytes[k])) {
      ++k;
    } else if (bytes.size() - k < event_bytes) {
      pending_size_ = bytes.size() - k;
      std::copy_n(bytes.data() + k, pending_size_, pending_.data());
      break;
    } else {
      take(bytes.subspan(k).first<event_bytes>(), events);
      k += event_bytes;
    }
  }
  return events;
}

bool EventStreamDecoder::begins_event(std::uint8_t byte) {
  if (kind_ == EventStreamKind::dvs) {
    if (byte == 0xff) t_ += 0x7f;
    return byte < 0xfe;  // 0xfe is padding
  }
  if (byte < 0xfc) return true;
  t_ += (byte & 0x03) * 0x3f;
  return false;
}

void EventStreamDecoder::take(std::span<const std::uint8_t, event_bytes> event, EventColumns& events) {
  const bool is_dvs = kind_ == EventStreamKind::dvs;
  t_ += is_dvs ? event[0] >> 1 : event[0] >> 2;
  if (!is_dvs && (event[0] & 0x01) != 0) return;
  events.append(static_cast<std::uint16_t>(event[1] | event[2] << 8),
                static_cast<std::uint16_t>(event[3] | event[4] << 8), t_,
                (event[0] & (is_dvs ? 0x01 : 0x02)) != 0);
}

}  // namespace emseg
