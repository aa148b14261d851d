// Delaunay triangulation of integer pixels by divide and conquer, after Guibas and Stolfi, "Primitives for
// the Manipulation of General Subdivisions and the Computation of Voronoi Diagrams", ACM TOG 1985, with the
// cuts in both directions of Dwyer, Algorithmica 1987.
//
// Pixels are cut into horizontal strips half as high as pixels lie apart on average.  Each strip is
// triangulated from left to right, then strips are merged from top to bottom.  All decisions are exact
// integer comparisons.
#include <algorithm>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "emseg/event_graph.hpp"
#include "pixel_box.hpp"

namespace emseg {
namespace {

// The pixels in the order of the algorithm: strip by strip, in a strip by (x, y).
struct Strips {
  std::vector<Pixel> pixels;        // relative to the corner of their box
  std::vector<std::int32_t> index;  // where each stands in the caller's array
  std::vector<std::int32_t> start;  // strips + 1; every strip holds at least two pixels
};

// Stable counting sort of `order` by key(order[k]) in 0 .. bins-1.
template <typename Key>
void counting_sort(std::vector<std::int32_t>& order, std::vector<std::int32_t>& scratch, std::size_t bins,
                   Key key) {
  std::vector<std::int32_t> start(bins + 1);
  for (const std::int32_t k : order) ++start[key(k) + 1];
  for (std::size_t bin = 1; bin < bins; ++bin) start[bin] += start[bin - 1];
  for (const std::int32_t k : order) scratch[start[key(k)]++] = k;
  order.swap(scratch);
}

Strips cut_into_strips(std::span<const Pixel> pixels, const PixelBox& box) {
  const std::size_t n = pixels.size();
  const std::size_t columns = static_cast<std::size_t>(box.width()) + 1;
  const std::size_t rows = static_cast<std::size_t>(box.height()) + 1;
  std::vector<std::int32_t> order(n), scratch(n), strip_of_row(rows);
  for (std::size_t k = 0; k < n; ++k) {
    order[k] = static_cast<std::int32_t>(k);
    ++strip_of_row[pixels[k].y - box.min_y];  // the count of the row, until its strip is known
  }

  // Pixels crowd along the edges of the scene, where they stand closer than a uniform spread would put them.
  // Strips of .25 to 1 uniform spacings took the same time on event windows; single rows or 4 spacings, a
  // third more.
  const double spacing_squared =
      static_cast<double>(columns) * static_cast<double>(rows) / static_cast<double>(n);
  Strips strips;
  strips.start.push_back(0);
  std::int32_t count = 0;
  std::size_t top = 0;
  for (std::size_t row = 0; row < rows; ++row) {
    const std::size_t height = row - top;
    if (static_cast<double>(4 * height * height) >= spacing_squared && count - strips.start.back() >= 2 &&
        static_cast<std::int32_t>(n) - count >= 2) {
      strips.start.push_back(count);
      top = row;
    }
    count += std::exchange(strip_of_row[row], static_cast<std::int32_t>(strips.start.size()) - 1);
  }
  strips.start.push_back(count);

  counting_sort(order, scratch, rows, [&](std::int32_t k) { return pixels[k].y - box.min_y; });
  counting_sort(order, scratch, columns, [&](std::int32_t k) { return pixels[k].x - box.min_x; });
  counting_sort(order, scratch, strips.start.size() - 1,
                [&](std::int32_t k) { return strip_of_row[pixels[k].y - box.min_y]; });
  strips.pixels.reserve(n);
  for (const std::int32_t k : order) {
    const Pixel pixel{pixels[k].x - box.min_x, pixels[k].y - box.min_y};
    if (!strips.pixels.empty() && strips.pixels.back() == pixel) {
      throw std::invalid_argument("pixel (" + std::to_string(pixels[k].x) + ", " +
                                  std::to_string(pixels[k].y) + ") appears twice, expected distinct pixels");
    }
    strips.pixels.push_back(pixel);
  }
  strips.index = std::move(order);
  return strips;
}

// A directed edge; its reverse is e ^ 1.  With x to the right and y upwards, `next` is the next edge
// anticlockwise around the origin, `previous` the next one clockwise.
using Edge = std::uint32_t;

// Ends of the convex hull of a triangulated set: the hull edge out of its first pixel that has the outside on
// its right, and the one out of its last pixel that has the outside on its left.
struct Hull {
  Edge first = 0;
  Edge last = 0;
};

// How a pixel sees a segment: |cross| cot(angle) = dot, and cross > 0 on the left of the segment.
struct Sight {
  std::int64_t cross = 0;
  std::int64_t dot = 0;

  bool above() const { return cross > 0; }
};

// `Product` holds cross * dot, at most w h (w^2 + h^2) in a box of w by h.
template <typename Product>
class Triangulator {
 public:
  explicit Triangulator(const Strips& strips) : pixels_(strips.pixels), strip_start_(strips.start) {
    half_edges_.reserve(6 * pixels_.size());  // a planar graph has fewer than three edges a vertex
    triangulate_strips(0, strip_start_.size() - 1);
  }

  std::vector<PixelEdge> edges(std::span<const std::int32_t> index) const {
    std::vector<PixelEdge> result;
    result.reserve(half_edges_.size() / 2);
    for (Edge e = 0; e < half_edges_.size(); e += 2) {
      if (half_edges_[e].origin == deleted) continue;
      const std::int32_t a = index[origin(e)], b = index[destination(e)];
      result.emplace_back(std::min(a, b), std::max(a, b));
    }
    return result;
  }

 private:
  static constexpr std::int32_t deleted = -1;

  struct HalfEdge {
    std::int32_t origin;
    Edge next, previous;
  };

  std::int32_t origin(Edge e) const { return half_edges_[e].origin; }
  std::int32_t destination(Edge e) const { return half_edges_[e ^ 1].origin; }
  Edge next(Edge e) const { return half_edges_[e].next; }
  Edge previous(Edge e) const { return half_edges_[e].previous; }

  Edge make_edge(std::int32_t from, std::int32_t to) {
    Edge e;
    if (free_.empty()) {
      e = static_cast<Edge>(half_edges_.size());
      half_edges_.resize(half_edges_.size() + 2);
    } else {
      e = free_.back();
      free_.pop_back();
    }
    half_edges_[e] = {from, e, e};
    half_edges_[e ^ 1] = {to, e ^ 1, e ^ 1};
    return e;
  }

  // Puts the lone edge e anticlockwise after `place` around their common origin.
  void insert_after(Edge place, Edge e) {
    const Edge follower = next(place);
    half_edges_[e].next = follower;
    half_edges_[e].previous = place;
    half_edges_[place].next = e;
    half_edges_[follower].previous = e;
  }

  void remove(Edge e) {
    for (const Edge half : {e, e ^ 1}) {
      half_edges_[next(half)].previous = previous(half);
      half_edges_[previous(half)].next = next(half);
      half_edges_[half].origin = deleted;
    }
    free_.push_back(e & ~Edge{1});
  }

  // The edge from the destination of a to the origin of b that closes their common left face.
  Edge connect(Edge a, Edge b) {
    const Edge e = make_edge(destination(a), origin(b));
    insert_after(previous(a ^ 1), e);
    insert_after(b, e ^ 1);
    return e;
  }

  // Twice the signed area; positive where c lies to the left of a -> b.
  std::int64_t orient(std::int32_t a, std::int32_t b, std::int32_t c) const {
    const Pixel &p = pixels_[a], &q = pixels_[b], &r = pixels_[c];
    return std::int64_t{q.x - p.x} * (r.y - p.y) - std::int64_t{q.y - p.y} * (r.x - p.x);
  }
  bool left_of(std::int32_t pixel, Edge e) const { return orient(origin(e), destination(e), pixel) > 0; }
  bool right_of(std::int32_t pixel, Edge e) const { return orient(origin(e), destination(e), pixel) < 0; }

  Sight sight(std::int32_t pixel, std::int32_t a, std::int32_t b) const {
    const Pixel &p = pixels_[a], &q = pixels_[b], &r = pixels_[pixel];
    return {orient(a, b, pixel),
            std::int64_t{r.x - p.x} * (r.x - q.x) + std::int64_t{r.y - p.y} * (r.y - q.y)};
  }

  // Whether the one pixel sees the base under a larger angle than the other, both above it: then it lies
  // inside the circle through the base and the other.
  static bool wider(const Sight& one, const Sight& other) {
    return Product{one.cross} * other.dot > Product{other.cross} * one.dot;
  }

  // Triangulates pixels begin .. end-1 of one strip, from left to right.
  Hull triangulate(std::int32_t begin, std::int32_t end) {
    const std::int32_t count = end - begin;
    if (count == 2) {
      const Edge e = make_edge(begin, begin + 1);
      return {e, e ^ 1};
    }
    if (count == 3) {
      const Edge a = make_edge(begin, begin + 1);
      const Edge b = make_edge(begin + 1, begin + 2);
      insert_after(a ^ 1, b);
      const std::int64_t area = orient(begin, begin + 1, begin + 2);
      if (area == 0) return {a, b ^ 1};
      const Edge c = connect(b, a);
      return area > 0 ? Hull{a, b ^ 1} : Hull{c ^ 1, c};
    }
    const std::int32_t middle = begin + count / 2;
    const Hull left = triangulate(begin, middle);
    const Hull right = triangulate(middle, end);
    return merge(left, right);
  }

  Hull triangulate_strips(std::size_t begin, std::size_t end) {
    if (end - begin == 1) return turn(triangulate(strip_start_[begin], strip_start_[end]));
    const std::size_t middle = begin + (end - begin) / 2;
    const Hull upper = triangulate_strips(begin, middle);
    const Hull lower = triangulate_strips(middle, end);
    return merge(upper, lower);
  }

  // From a hull whose first pixel is least by (x, y) to one whose first pixel is least by (y, -x): the same
  // order in a frame turned by a right angle.  Merging knows no frame, only which set comes first.
  Hull turn(const Hull& hull) const {
    const auto before = [this](std::int32_t a, std::int32_t b) {
      const Pixel &p = pixels_[a], &q = pixels_[b];
      return p.y != q.y ? p.y < q.y : p.x > q.x;
    };
    Hull turned{hull.first, hull.first ^ 1};
    Edge e = hull.first;
    do {
      if (before(origin(e), origin(turned.first))) turned.first = e;
      if (before(origin(turned.last), destination(e))) turned.last = e ^ 1;
      e = next(e ^ 1);
    } while (e != hull.first);
    return turned;
  }

  // Joins two triangulations that a line separates, the left one first: from their lower common tangent
  // upwards, each new edge goes to the pixel that sees the last one, the base, under the largest angle.
  Hull merge(const Hull& left, const Hull& right) {
    Hull hull{left.first, right.last};
    Edge inner_left = left.last, inner_right = right.first;
    while (true) {
      if (left_of(origin(inner_right), inner_left)) {
        inner_left = previous(inner_left ^ 1);
      } else if (right_of(origin(inner_left), inner_right)) {
        inner_right = next(inner_right ^ 1);
      } else {
        break;
      }
    }
    Edge base = connect(inner_right ^ 1, inner_left);
    if (origin(inner_left) == origin(left.first)) hull.first = base ^ 1;
    if (origin(inner_right) == origin(right.last)) hull.last = base;

    while (true) {
      const std::int32_t a = destination(base),
                         b = origin(base);  // a -> b runs from the left set to the right one
      Edge left_candidate = next(base ^ 1);
      Sight left_sight = sight(destination(left_candidate), a, b);
      while (left_sight.above()) {
        const Edge rival = next(left_candidate);
        const Sight rival_sight = sight(destination(rival), a, b);
        if (!rival_sight.above() || !wider(rival_sight, left_sight)) break;
        remove(left_candidate);
        left_candidate = rival;
        left_sight = rival_sight;
      }
      Edge right_candidate = previous(base);
      Sight right_sight = sight(destination(right_candidate), a, b);
      while (right_sight.above()) {
        const Edge rival = previous(right_candidate);
        const Sight rival_sight = sight(destination(rival), a, b);
        if (!rival_sight.above() || !wider(rival_sight, right_sight)) break;
        remove(right_candidate);
        right_candidate = rival;
        right_sight = rival_sight;
      }
      if (!left_sight.above() && !right_sight.above()) return hull;
      if (!left_sight.above() || (right_sight.above() && wider(right_sight, left_sight))) {
        base = connect(right_candidate, base ^ 1);
      } else {
        base = connect(base ^ 1, left_candidate ^ 1);
      }
    }
  }

  std::span<const Pixel> pixels_;
  std::span<const std::int32_t> strip_start_;
  std::vector<HalfEdge> half_edges_;
  std::vector<Edge> free_;
};

__extension__ using Int128 = __int128;

}  // namespace

std::vector<PixelEdge> delaunay_edges(std::span<const Pixel> pixels) {
  if (pixels.size() < 2) return {};
  if (pixels.size() > std::numeric_limits<std::int32_t>::max() / 6) {
    throw std::invalid_argument(std::to_string(pixels.size()) + " pixels, expected at most 2^31 / 6");
  }
  const PixelBox box = bounding_box(pixels);
  const Strips strips = cut_into_strips(pixels, box);
  const double w = static_cast<double>(box.width()), h = static_cast<double>(box.height());
  const bool fits_64_bits = w * h * (w * w + h * h) < 0x1p62;  // every box up to 38967 x 38967
  return fits_64_bits ? Triangulator<std::int64_t>(strips).edges(strips.index)
                      : Triangulator<Int128>(strips).edges(strips.index);
}

}  // namespace emseg
