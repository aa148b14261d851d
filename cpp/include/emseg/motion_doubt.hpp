// Doubt about motions that explain by chance: fast ones, and those along the edges that they are to explain.
#pragma once

#include <cstdint>
#include <vector>

#include "emseg/edge_directions.hpp"
#include "emseg/model_selection.hpp"

namespace emseg {

// Side of the blocks that share a doubt, px.
constexpr int doubt_block = 8;

// The further a motion goes, the more pixels there are on its way whose events may meet by chance: what is as
// sharp by a slow motion is better explained by it (a prior as that of Weiss, Simoncelli & Adelson, "Motion
// illusions as optimal percepts", Nature Neuroscience 2002).
//
// Most of all where edges run one way.  How far they go along themselves is not seen, and yet an edge that
// nearly follows a column of pixels and drifts across it passes one pixel of the column after the other:
// warped fast along the column, its events fall on one point, sharper than by its true motion.
struct DoubtOptions {
  // What an event costs more by a motion, times log(1 + px over the window / 10),
  double speed = 0;
  double edge = 0;  // and times the same of what it goes along the edges of its block.
};

// What the events of each block cost more by a model.
class MotionDoubt {
 public:
  // `window` in s; `edges` of each block, or none.
  MotionDoubt(const BlockGrid& grid, double window, const DoubtOptions& options,
              std::vector<EdgeDirection> edges = {});

  // Of a model, per block.
  std::vector<std::int32_t> of(const MotionModel& model, const WarpFrame& frame) const;

 private:
  std::size_t block_count_;
  DoubtOptions options_;
  std::vector<EdgeDirection> edges_;
  Points ends_;  // the middle of every block, at the window's beginning and at its end
};

}  // namespace emseg
