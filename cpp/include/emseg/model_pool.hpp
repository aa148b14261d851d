// The model pool: candidate motions of a window, proposed by sub-volumes and chosen over blocks of the image.
#pragma once

#include <vector>

#include "emseg/data_term.hpp"
#include "emseg/motion_doubt.hpp"
#include "emseg/motion_fit.hpp"
#include "emseg/region_velocities.hpp"
#include "emseg/tracked_object.hpp"

namespace emseg {

struct PoolOptions {
  int bracket_row = 6;                                    // h = 1..bracket_row sub-volumes down the image
  int bracket_col = 6;                                    // and as many across
  std::vector<MotionKind> kinds{MotionKind::similarity};  // kinds that a label may have
  RegionVelocityOptions search;
  RefineOptions refine;
  DataTerm term = DataTerm::logarithmic;
  double lambda_data = 1;
  double lambda_label = 8000;
  double tracked_share = 1;          // of lambda_label, that a tracked model costs
  DoubtOptions doubt;                // in units of the data term
  std::vector<EdgeDirection> edges;  // per block of the plane, or none
  double sigma = 1;                  // blur of the data term's images, px
  int block = doubt_block;           // side of the blocks that models are chosen over, px
  int tile = 64;                     // side of the smallest sub-volumes, which overlap by half, px
  double same_motion = 2.5;          // velocities closer than this, px over the window, count as one
  std::size_t max_candidates = 64;
  std::size_t max_events = 16000;       // used of a window
  std::size_t max_refit_events = 2000;  // used of a model's
  int max_rounds = 2;                   // of refitting and choosing again
  std::vector<MotionModel> candidates;  // further ones, such as the last window's models
  std::vector<TrackedObject> tracked;   // objects that are known to be there
};

struct ModelPool {
  std::vector<MotionModel> models;
  std::vector<std::int32_t> object;  // per model: which tracked object moves by it, or no_object
};

// Sub-volumes of the image plane: for h = 1, 2, .. an h x h division (bracket_row and bracket_col bound it
// each way), the remainder of the division in the last row and column.
std::vector<Region> sub_volumes(Region plane, int bracket_row, int bracket_col);

// The motions that together explain the window's events for the least cost: data cost plus lambda_label a
// model. The candidates of all sub-volumes come from one pass over pairs of events; a greedy facility
// location over blocks of the image chooses among them; the chosen are refitted, alone and in pairs, on the
// events of their blocks and chosen again. Never empty.  Deterministic for any number of threads.
ModelPool make_model_pool(const PointView& points, std::span<const std::uint8_t> positive,
                          const WarpFrame& frame, Region plane, const PoolOptions& options, ThreadPool& pool);

}  // namespace emseg
