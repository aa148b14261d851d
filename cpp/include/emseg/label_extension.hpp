// Labels of all events of a window from those of a sample of them.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "emseg/motion_model.hpp"

namespace emseg {

// The label, for every point, that most of the sample's events near it have.  Near is after warping by the
// label's motion: each label's own events make an image of warped events, blurred by `taps`, and a point
// takes the label whose image is brightest at its warped place.  With signs it is the brightest of the
// point's own, and only where none is, the brightest of events of either.  -1 where all are dark.  `sample`
// are indices of points and `labels` theirs, >= -1; sample points keep their labels.
std::vector<std::int32_t> extend_labels(const PointView& points, std::span<const std::size_t> sample,
                                        std::span<const std::int32_t> labels,
                                        std::span<const MotionModel> models, const WarpFrame& frame,
                                        Region plane, std::span<const float> taps);

}  // namespace emseg
