// The labels of a window from coarse to fine: expansion on blocks of pixels, on the pixels near the
// boundaries that it finds, and at last on the events near those.  Whole labels take each other's place
// first, wherever that lowers the energy: cuts between near copies of one motion are the dearest.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "emseg/event_graph.hpp"
#include "emseg/expansion.hpp"

namespace emseg {

// The problem that `expansion` solves on the event graph of a window, in the layout of a pool of models:
// E(L) = sum_k unary[L_k][k] + smooth_cost |{edges between labels}| + sum_l label_cost_l [l is used].
struct WindowLabeling {
  std::span<const std::span<const std::int32_t>> unary;  // per label, per event; may be negative
  std::int32_t smooth_cost = 0;                          // of an edge; >= 0
  std::span<const std::int64_t> label_cost;              // labels, or one for all; >= 0

  std::size_t label_count() const { return unary.size(); }
  std::int64_t cost_of_label(std::size_t l) const { return label_cost[label_cost.size() == 1 ? 0 : l]; }
};

// The energy of labels, without the event graph: what `labeling_energy` gives with it.
// Throws std::invalid_argument as BandExpansion::minimise does.
std::int64_t window_energy(const PixelGraph& graph, const WindowLabeling& problem,
                           std::span<const std::int32_t> labels);

struct BandOptions {
  int block_side = 4;  // px
  int hops = 2;        // from a boundary to the end of the band around it, over neighbouring pixels
  int max_sweeps = 2;  // over all labels, on every level
  int max_bands = 4;   // of events, each where the last one changed labels at its end

  // Share of the energy: a sweep over pixels or events that gains no more is the last.
  double least_gain = 1e-3;

  // Boundaries of blocks cut edges that finer ones avoid.  With this share of the smoothness blocks show
  // where else a boundary might pay; what they show is weighed exactly on the finer levels.
  double lenient_smoothness = 0.7;
};

// Energies lie about a hundredth of a per cent above those of `expansion` on all events, at a tenth of its
// time; label costs count exactly throughout.  The blocks are made once for all problems of a window.
class BandExpansion {
 public:
  // The graph and the workspace must outlive it.
  BandExpansion(const PixelGraph& graph, ExpansionWorkspace& workspace, const BandOptions& options = {});
  ~BandExpansion();
  BandExpansion(BandExpansion&&) noexcept;
  BandExpansion& operator=(BandExpansion&&) noexcept;

  // Without `initial`, labels are sought from the blocks down.  With it, they are the initial labels but near
  // their boundaries and where blocks prefer others, and their energy is never higher.  The trace holds the
  // energy before and after.  Throws std::invalid_argument where shapes, labels or costs do not fit, or where
  // the energy could overflow.
  ExpansionResult minimise(const WindowLabeling& problem, std::span<const std::int32_t> initial = {});

 private:
  class Levels;
  std::unique_ptr<Levels> levels_;
};

}  // namespace emseg
