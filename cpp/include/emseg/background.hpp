// Which label is the background, and which events are noise.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

// How a label lies in the image: tiles that it holds, and how widely they are spread.
struct LabelExtent {
  int tiles = 0;      // 16 px tiles in which the label has most events, three or more
  double share = 0;   // of all tiles of the sensor
  double spread = 0;  // area of their standard ellipse over that of tiles all over the sensor: 0..about 1
};

std::vector<LabelExtent> label_extents(const PointView& points, std::span<const std::int32_t> labels,
                                       std::int32_t label_count, Region plane);

// The label whose motion is the camera's: the one that holds the most tiles among those that span the scene,
// not the one with most events.  None (-1) where no label spans it: then the camera stands still and only
// objects make events.
std::int32_t background_label(std::span<const LabelExtent> extents);

// How near an event's company is looked for, px: one, or two where fewer than one in nine pixels has an
// event, since nobody would have company by chance within one.
int company_radius(std::size_t events, Region plane);

// 1 for events with fewer than `company` other events of their label within `radius` px (a square
// neighbourhood) at t_ref. Events warped off the canvas are not followed: they keep nobody company, and are
// not judged themselves.
std::vector<std::uint8_t> find_lonely_events(const PointView& points, std::span<const std::int32_t> labels,
                                             std::span<const MotionModel> models, const WarpFrame& frame,
                                             Region plane, int company, int radius);

}  // namespace emseg
