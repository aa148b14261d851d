// Images of counts and times from slices of events, as networks take them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/event.hpp"

namespace emseg {

struct EventSliceOptions {
  std::int64_t width_us = 50'000;  // of a slice, half before and half after its time (EV-IMO)
  int shrink = 1;                  // pixels of the sensor that make one of the image, each way
};

// For each time an image of three planes, rows of pixels: 50 times the number of rises, 255 times the mean
// time of the events (0 .. 1 within the slice), 50 times the number of falls; all at most 255.  A slice holds
// the events from its time - width/2 on and before its time + width/2.  Columns and rows of the sensor that
// do not fill a last pixel are left out.  Result: times.size() images of 3 planes, one after the other.
//
// After Mitrokhin et al., "EV-IMO: motion segmentation dataset and learning pipeline for event cameras",
// 2019.
//
// Throws std::invalid_argument where the events are not sound (see check_events), the width is not positive,
// or shrink is not within 1 .. the shorter side of the sensor.
std::vector<std::uint8_t> event_slices(const EventView& events, ImageSize size,
                                       std::span<const std::int64_t> times,
                                       const EventSliceOptions& options = {});

}  // namespace emseg
