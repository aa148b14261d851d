#include "emseg/evt_decoder.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>
#include <string>

namespace emseg {

namespace {

template <typename Word>
Word load(const std::uint8_t* bytes) {
  Word word = 0;
  for (std::size_t k = 0; k < sizeof(Word); ++k) {
    word = static_cast<Word>(word | static_cast<Word>(bytes[k]) << (8 * k));
  }
  return word;
}

// One event for each bit of `valid`, lowest first, at columns x, x + 1, ...
void append_row(std::uint32_t valid, std::uint16_t x, std::uint16_t y, std::int64_t t, bool rise,
                EventColumns& events) {
  for (; valid != 0; valid &= valid - 1) {
    events.append(static_cast<std::uint16_t>(x + std::countr_zero(valid)), y, t, rise);
  }
}

}  // namespace

EventColumns EvtDecoder::decode(std::span<const std::uint8_t> bytes) {
  EventColumns events;
  switch (encoding_) {
    case EvtEncoding::evt3:
      decode_words<std::uint16_t>(bytes, events);
      break;
    case EvtEncoding::evt2:
      decode_words<std::uint32_t>(bytes, events);
      break;
    case EvtEncoding::evt21:
    case EvtEncoding::evt21_swapped:
      decode_words<std::uint64_t>(bytes, events);
      break;
  }
  return events;
}

template <typename Word>
void EvtDecoder::decode_words(std::span<const std::uint8_t> bytes, EventColumns& events) {
  // A word for an event is the rule; vectors may still make the columns grow.
  const std::size_t expected = bytes.size() / sizeof(Word);
  events.x.reserve(expected);
  events.y.reserve(expected);
  events.t.reserve(expected);
  events.p.reserve(expected);
  if (pending_size_ > 0) {
    const std::size_t missing = std::min(sizeof(Word) - pending_size_, bytes.size());
    std::copy_n(bytes.data(), missing, pending_.data() + pending_size_);
    pending_size_ += missing;
    bytes = bytes.subspan(missing);
    if (pending_size_ < sizeof(Word)) return;
    take(load<Word>(pending_.data()), events);
    pending_size_ = 0;
  }
  const std::size_t whole = bytes.size() - bytes.size() % sizeof(Word);
  for (std::size_t k = 0; k < whole; k += sizeof(Word)) take(load<Word>(bytes.data() + k), events);
  pending_size_ = bytes.size() - whole;
  std::copy_n(bytes.data() + whole, pending_size_, pending_.data());
}

void EvtDecoder::set_time_high(std::int64_t high, int high_bits, int low_bits) {
  // A fall by more than half the range is the counter starting again; a smaller one is left as it is, for
  // the check of time order to find.
  if (has_time_ && high_ - high > (std::int64_t{1} << (high_bits - 1))) ++wraps_;
  if (high != high_) low_ = 0;
  high_ = high;
  base_ = ((wraps_ << high_bits) + high) << low_bits;
  if (!has_time_) origin_ = encoding_ == EvtEncoding::evt3 ? base_ - (std::int64_t{1} << low_bits) : base_;
  has_time_ = true;
}

// EVT 3: the state of time, row and polarity is sent only where it changes.
void EvtDecoder::take(std::uint16_t word, EventColumns& events) {
  const auto payload = static_cast<std::uint16_t>(word & 0xfff);
  const auto address = static_cast<std::uint16_t>(word & 0x7ff);
  switch (word >> 12) {
    case 0x0:
      y_ = address;
      break;
    case 0x2:
      if (has_time_) events.append(address, y_, base_ + low_, (word & 0x800) != 0);
      break;
    case 0x3:
      x_base_ = address;
      rise_ = (word & 0x800) != 0;
      break;
    case 0x4:
      if (has_time_) append_row(payload, x_base_, y_, base_ + low_, rise_, events);
      x_base_ = static_cast<std::uint16_t>(x_base_ + 12);
      break;
    case 0x5:
      if (has_time_) append_row(payload & 0xff, x_base_, y_, base_ + low_, rise_, events);
      x_base_ = static_cast<std::uint16_t>(x_base_ + 8);
      break;
    case 0x6:
      low_ = payload;
      break;
    case 0x8:
      set_time_high(payload, 12, 12);
      break;
    default:
      break;  // triggers, and what is the vendor's own
  }
}

// EVT 2: each event is a word, with the low 6 bits of its time.
void EvtDecoder::take(std::uint32_t word, EventColumns& events) {
  const std::uint32_t kind = word >> 28;
  if (kind == 0x8) {
    set_time_high(word & 0xfffffff, 28, 6);
  } else if (kind <= 0x1 && has_time_) {
    events.append(static_cast<std::uint16_t>((word >> 11) & 0x7ff), static_cast<std::uint16_t>(word & 0x7ff),
                  base_ + ((word >> 22) & 0x3f), kind == 0x1);
  }
}

// EVT 2.1: as EVT 2, for 32 pixels of a row at once.
void EvtDecoder::take(std::uint64_t word, EventColumns& events) {
  if (encoding_ == EvtEncoding::evt21_swapped) word = std::rotl(word, 32);
  const auto high = static_cast<std::uint32_t>(word >> 32);
  const std::uint32_t kind = high >> 28;
  if (kind == 0x8) {
    set_time_high(high & 0xfffffff, 28, 6);
  } else if (kind <= 0x1 && has_time_) {
    append_row(static_cast<std::uint32_t>(word), static_cast<std::uint16_t>((high >> 11) & 0x7ff),
               static_cast<std::uint16_t>(high & 0x7ff), base_ + ((high >> 22) & 0x3f), kind == 0x1, events);
  }
}

EventColumns decode_libcaer_packet(std::span<const std::uint8_t> bytes) {
  EventColumns events;
  std::int64_t high = 0;
  std::int64_t low = 0;
  std::uint16_t x = 0;
  std::uint16_t y_base = 0;
  bool rise = false;
  if (bytes.size() % 2 != 0) {
    throw std::invalid_argument("packet has " + std::to_string(bytes.size()) +
                                " bytes, expected whole words of 2");
  }
  for (std::size_t k = 0; k < bytes.size(); k += 2) {
    const auto word = load<std::uint16_t>(bytes.data() + k);
    const auto address = static_cast<std::uint16_t>(word & 0x7ff);
    switch (word >> 12) {
      case 0x0:
        high = std::int64_t{word & 0xfff} << 12;
        break;
      case 0x1:
        low = word & 0xfff;
        break;
      case 0x2:
        x = address;
        break;
      case 0x3:
        events.append(x, address, high + low, (word & 0x800) != 0);
        break;
      case 0x4:
        y_base = address;
        rise = (word & 0x800) != 0;
        break;
      case 0x5:
        for (std::uint32_t valid = word & 0xff; valid != 0; valid &= valid - 1) {
          events.append(x, static_cast<std::uint16_t>(y_base + std::countr_zero(valid)), high + low, rise);
        }
        y_base = static_cast<std::uint16_t>(y_base + 8);
        break;
      default:
        throw std::invalid_argument("byte " + std::to_string(k) + ": word of kind " +
                                    std::to_string(word >> 12) + ", expected 0..5");
    }
  }
  return events;
}

}  // namespace emseg
