// The triangulations, ours and CGAL's, against what defines it, in exact arithmetic: the right number of
// edges, none crossing another, each with a circle through its ends that holds no pixel.
#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>
#include <stdexcept>
#include <string>

#include "emseg/event_graph.hpp"

using namespace emseg;

namespace {

using Triangulate = std::vector<PixelEdge> (*)(std::span<const Pixel>);

std::vector<PixelEdge> sorted_edges(Triangulate triangulate, const std::vector<Pixel>& pixels) {
  std::vector<PixelEdge> edges = triangulate(pixels);
  std::sort(edges.begin(), edges.end());
  return edges;
}

// Both must give exactly these edges.
void check_edges(const std::vector<Pixel>& pixels, const std::vector<PixelEdge>& expected) {
  CHECK(sorted_edges(delaunay_edges, pixels) == expected);
  CHECK(sorted_edges(delaunay_edges_cgal, pixels) == expected);
}

__extension__ using Wide = __int128;

// Twice the signed area of a triangle; positive where c lies to the left of a -> b.
std::int64_t orient(Pixel a, Pixel b, Pixel c) {
  return std::int64_t{b.x - a.x} * (c.y - a.y) - std::int64_t{b.y - a.y} * (c.x - a.x);
}

// Positive where d lies inside the circle through a, b, c in anticlockwise order: the textbook 3 x 3
// determinant.
Wide in_circle(Pixel a, Pixel b, Pixel c, Pixel d) {
  const auto row = [d](Pixel p) {
    const Wide x = p.x - d.x, y = p.y - d.y;
    return std::array<Wide, 3>{x, y, x * x + y * y};
  };
  const auto [ax, ay, az] = row(a);
  const auto [bx, by, bz] = row(b);
  const auto [cx, cy, cz] = row(c);
  return az * (bx * cy - by * cx) - bz * (ax * cy - ay * cx) + cz * (ax * by - ay * bx);
}

bool collinear(const std::vector<Pixel>& pixels) {
  return std::all_of(pixels.begin(), pixels.end(),
                     [&](Pixel p) { return orient(pixels[0], pixels[1], p) == 0; });
}

// Pixels on the boundary of the convex hull, corners or not (Andrew's monotone chain).
std::size_t hull_size(std::vector<Pixel> pixels) {
  std::sort(pixels.begin(), pixels.end(),
            [](Pixel a, Pixel b) { return std::pair(a.x, a.y) < std::pair(b.x, b.y); });
  std::size_t size = 0;
  for (int side = 0; side < 2; ++side) {
    std::vector<Pixel> chain;
    for (const Pixel p : pixels) {
      while (chain.size() >= 2 && orient(chain[chain.size() - 2], chain.back(), p) < 0) chain.pop_back();
      chain.push_back(p);
    }
    size += chain.size() - 1;
    std::reverse(pixels.begin(), pixels.end());
  }
  return size;
}

// Whether some circle through a and b holds no pixel in its inside, and no pixel lies between them.
bool has_empty_circle(const std::vector<Pixel>& pixels, Pixel a, Pixel b) {
  const Pixel* left = nullptr;
  const Pixel* right = nullptr;
  for (const Pixel& p : pixels) {
    const std::int64_t side = orient(a, b, p);
    if (side > 0 && (left == nullptr || in_circle(a, b, *left, p) > 0)) left = &p;
    if (side < 0 && (right == nullptr || in_circle(b, a, *right, p) > 0)) right = &p;
    if (side == 0 && !(p == a) && !(p == b)) {
      const std::int64_t along =
          std::int64_t{p.x - a.x} * (p.x - b.x) + std::int64_t{p.y - a.y} * (p.y - b.y);
      if (along < 0) return false;
    }
  }
  return left == nullptr || right == nullptr || in_circle(a, b, *left, *right) <= 0;
}

bool cross(Pixel a, Pixel b, Pixel c, Pixel d) {
  const auto sign = [](std::int64_t v) { return (v > 0) - (v < 0); };
  return sign(orient(a, b, c)) * sign(orient(a, b, d)) < 0 &&
         sign(orient(c, d, a)) * sign(orient(c, d, b)) < 0;
}

// Checks everything that makes a Delaunay triangulation; quadratic, for up to some thousand pixels.
void check_delaunay(const std::vector<Pixel>& pixels, Triangulate triangulate) {
  const std::vector<PixelEdge> edges = sorted_edges(triangulate, pixels);
  const std::size_t n = pixels.size();
  const std::size_t expected = collinear(pixels) ? n - 1 : 3 * n - 3 - hull_size(pixels);
  CHECK(edges.size() == expected);
  CHECK(std::adjacent_find(edges.begin(), edges.end()) == edges.end());
  bool ordered = true, empty = true;
  for (const auto& [a, b] : edges) {
    ordered = ordered && 0 <= a && a < b && b < static_cast<std::int32_t>(n);
    empty = empty && ordered && has_empty_circle(pixels, pixels[a], pixels[b]);
  }
  CHECK(ordered);
  CHECK(empty);
  if (!ordered || n > 300) return;  // crossings cost the square of the edges
  bool planar = true;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      planar = planar && !cross(pixels[edges[i].first], pixels[edges[i].second], pixels[edges[j].first],
                                pixels[edges[j].second]);
    }
  }
  CHECK(planar);
}

void check_delaunay(const std::vector<Pixel>& pixels) {
  check_delaunay(pixels, delaunay_edges);
  check_delaunay(pixels, delaunay_edges_cgal);
}

std::vector<Pixel> random_pixels(std::size_t count, int width, int height, std::uint32_t seed,
                                 int origin = 0) {
  std::mt19937 random(seed);
  std::set<std::pair<int, int>> distinct;
  while (distinct.size() < count) {
    const int x = static_cast<int>(random() % width), y = static_cast<int>(random() % height);
    distinct.emplace(x + origin, y + origin);
  }
  std::vector<Pixel> pixels;
  for (const auto& [x, y] : distinct) pixels.push_back({x, y});
  std::shuffle(pixels.begin(), pixels.end(), random);
  return pixels;
}

std::vector<Pixel> full_grid(int width, int height) {
  std::vector<Pixel> pixels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) pixels.push_back({x, y});
  }
  return pixels;
}

}  // namespace

TEST_CASE("few pixels") {
  check_edges({}, {});
  check_edges({{3, 4}}, {});
  check_edges({{3, 4}, {0, 9}}, {{0, 1}});
  check_edges({{0, 0}, {1, 0}, {0, 1}}, {{0, 1}, {0, 2}, {1, 2}});
}

TEST_CASE("collinear pixels give the path along their line, in whatever order they come") {
  check_edges({{4, 0}, {0, 0}, {9, 0}, {2, 0}}, {{0, 2}, {0, 3}, {1, 3}});
  check_edges({{3, 8}, {3, 1}, {3, 2}}, {{0, 2}, {1, 2}});
  check_edges({{0, 30}, {10, 20}, {30, 0}}, {{0, 1}, {1, 2}});
  check_edges({{0, 0}, {10, 20}, {30, 60}, {5, 10}}, {{0, 3}, {1, 2}, {1, 3}});
}

TEST_CASE("small sets of every density") {
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    CAPTURE(seed);
    const int side = 3 + static_cast<int>(seed % 10);
    check_delaunay(random_pixels(3 + seed % static_cast<std::uint32_t>(side * side - 3), side, side, seed));
  }
}

TEST_CASE("every set of pixels on a small grid") {
  for (const auto& [width, height] : {std::pair{4, 3}, {2, 6}, {3, 4}, {6, 2}}) {
    const std::vector<Pixel> grid = full_grid(width, height);
    for (std::uint32_t members = 1; members < (1u << grid.size()); ++members) {
      std::vector<Pixel> pixels;
      for (std::size_t k = 0; k < grid.size(); ++k) {
        if ((members >> k & 1) != 0) pixels.push_back(grid[k]);
      }
      if (pixels.size() < 2) continue;
      CAPTURE(members);
      check_delaunay(pixels);
    }
  }
}

TEST_CASE("sparse and dense sets as a sensor gives them") {
  check_delaunay(random_pixels(300, 240, 180, 1));
  check_delaunay(random_pixels(1500, 240, 180, 2));
  check_delaunay(random_pixels(1500, 50, 40, 3));
  check_delaunay(random_pixels(280, 5, 60, 4));
  check_delaunay(random_pixels(280, 200, 2, 5));
}

TEST_CASE("coordinates that need more than doubles, and negative ones") {
  check_delaunay(random_pixels(300, 65536, 65536, 1));
  check_delaunay(random_pixels(300, 65536, 65536, 2, -32768));
  check_delaunay(random_pixels(300, 8193, 8193, 3, 1'000'000));
  check_delaunay(random_pixels(300, 65536, 3, 4));
  // Four corners nearly on one circle, at the far ends of the range.
  check_delaunay({{0, 0}, {65535, 0}, {0, 65535}, {65535, 65534}, {32767, 32767}});
  check_delaunay({{0, 0}, {65535, 1}, {65534, 65535}, {1, 65534}});
  check_delaunay({{0, 0}, {65535, 65535}, {65534, 65535}, {65535, 65534}, {1, 0}, {32767, 32768}});
}

TEST_CASE("cocircular pixels are triangulated") {
  const int r = 1105;  // 5 * 13 * 17: 108 pixels on this circle
  std::vector<Pixel> circle;
  for (int x = -r; x <= r; ++x) {
    for (int y = -r; y <= r; ++y) {
      if (x * x + y * y == r * r) circle.push_back({x, y});
    }
  }
  REQUIRE(circle.size() == 108);
  check_delaunay(circle);
  circle.push_back({0, 0});
  check_delaunay(circle);
}

TEST_CASE("crosses, corners and combs") {
  std::vector<Pixel> cross_shape, corner, comb;
  for (int k = -20; k <= 20; ++k) {
    cross_shape.push_back({k, 0});
    if (k != 0) cross_shape.push_back({0, k});
    corner.push_back({k, -20});
    if (k != -20) corner.push_back({-20, k});
    for (int tooth = 0; tooth < 5; ++tooth) comb.push_back({7 * tooth, k});
  }
  check_delaunay(cross_shape);
  check_delaunay(corner);
  check_delaunay(comb);
}

TEST_CASE("a full sensor: every cell has its four sides and one diagonal") {
  const int width = 240, height = 180;
  const std::vector<PixelEdge> edges = delaunay_edges(full_grid(width, height));
  std::size_t right = 0, down = 0, diagonal = 0;
  std::set<std::int32_t> cells_cut;
  for (const auto& [a, b] : edges) {
    if (b - a == 1 && b % width != 0) ++right;
    if (b - a == width) ++down;
    if (b - a == width + 1 && b % width != 0 && cells_cut.insert(a).second) ++diagonal;
    if (b - a == width - 1 && a % width != 0 && cells_cut.insert(a - 1).second) ++diagonal;
  }
  CHECK(right == std::size_t{(width - 1) * height});
  CHECK(down == std::size_t{width * (height - 1)});
  CHECK(diagonal == std::size_t{(width - 1) * (height - 1)});
  CHECK(edges.size() == right + down + diagonal);
}

TEST_CASE("the same pixels give the same edges") {
  const std::vector<Pixel> pixels = random_pixels(500, 30, 30, 6);
  CHECK(delaunay_edges(pixels) == delaunay_edges(pixels));
}

TEST_CASE("ours equals CGAL's where no four neighbours are cocircular") {
  const std::vector<Pixel> pixels = random_pixels(20000, 65536, 65536, 8);
  const std::vector<PixelEdge> ours = sorted_edges(delaunay_edges, pixels);
  const std::vector<PixelEdge> theirs = sorted_edges(delaunay_edges_cgal, pixels);
  CHECK(ours == theirs);
}

TEST_CASE("pixels that coincide or lie too far apart are refused by name") {
  Triangulate triangulate = nullptr;
  SUBCASE("ours") { triangulate = delaunay_edges; }
  SUBCASE("CGAL's") { triangulate = delaunay_edges_cgal; }
  const auto complaint = [&](const std::vector<Pixel>& pixels) -> std::string {
    try {
      triangulate(pixels);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  CHECK(complaint({{1, 2}, {5, 5}, {1, 2}}).find("pixel (1, 2) appears twice") == 0);
  CHECK(complaint({{1, 2}, {1, 2}}).find("pixel (1, 2) appears twice") == 0);
  CHECK(complaint({{0, 0}, {3, 0}, {6, 0}, {3, 0}}).find("pixel (3, 0) appears twice") == 0);
  CHECK(complaint({{-1, 0}, {65535, 5}}).find("pixels span 65536 x 5 px") == 0);
}
