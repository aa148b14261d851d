#include "emseg/warp_events.hpp"

#include <stdexcept>
#include <string>

#include "event_positions.hpp"

namespace emseg {
namespace {

Vec2f place_of(const EventView& events, std::size_t k, const PixelPlaces& places) {
  if (places.x.empty()) return {static_cast<float>(events.x[k]), static_cast<float>(events.y[k])};
  const std::size_t pixel = std::size_t{events.y[k]} * static_cast<std::size_t>(places.width) + events.x[k];
  if (pixel >= places.x.size() || pixel >= places.y.size()) {
    throw std::invalid_argument("event " + std::to_string(k) + " lies on pixel " + std::to_string(pixel) +
                                ", expected one of " + std::to_string(places.x.size()));
  }
  return {places.x[pixel], places.y[pixel]};
}

}  // namespace

std::vector<Vec2f> warp_events(const EventView& events, std::span<const std::int64_t> own, std::int64_t t_ref,
                               const MotionModel& model, const WarpFrame& frame, const PixelPlaces& places) {
  std::vector<Vec2f> warped(own.size());
  std::visit(
      [&](const auto& motion) {
        const typename std::decay_t<decltype(motion)>::Warp warp(motion, frame);
        for (std::size_t i = 0; i < own.size(); ++i) {
          const std::size_t k = event_at(own[i], events);
          const Vec2f from = place_of(events, k, places);
          warped[i] = warp(from.x, from.y, static_cast<float>(seconds_between(t_ref, events.t[k])));
        }
      },
      model);
  return warped;
}

}  // namespace emseg
