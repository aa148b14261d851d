// Windows as long as the motion in them asks for: some pixels of it, whatever the event rate.
#pragma once

#include "emseg/event.hpp"
#include "emseg/parallel.hpp"
#include "emseg/region_velocities.hpp"

namespace emseg {

struct AdaptiveWindowOptions {
  double displacement = 14;  // px that most of the scene moves within a window
  std::int64_t min_duration_us = 1'000;
  std::int64_t max_duration_us = 200'000;
  std::size_t max_events = 500'000;  // of a window
  double max_speed = 5000;           // px/s
};

// Duration of the window that begins with event `begin`, judged from the events that follow it.  The
// velocities of tiles are measured over a ladder of doubling durations.  Over too short a time they are
// accidents, over too long a time they are not uniform; those of tiles that agree with their neighbours, and
// that repeat from rung to rung, are the scene's.  Throws std::invalid_argument where an event that is looked
// at is not valid (see check_events).
std::int64_t judge_duration(const EventView& events, std::size_t begin, ImageSize size,
                            const AdaptiveWindowOptions& options, ThreadPool& pool);

// The duration that would have moved the events by the wanted displacement, from one that moved them by
// `displacement` px; changes at the most by a factor of two.
std::int64_t next_duration(std::int64_t duration_us, double displacement,
                           const AdaptiveWindowOptions& options);

}  // namespace emseg
