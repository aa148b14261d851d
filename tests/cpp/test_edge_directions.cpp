#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "emseg/edge_directions.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

// An image without bounds: what is at a pixel.
using Values = std::function<double(int, int)>;

// The definition, in double precision and pixel by pixel: gradients of the blurred image, and the products
// that they make at a pixel.
struct Products {
  double xx, xy, yy;
};

Products products_at(const Values& image, int x, int y) {
  constexpr double blur[] = {0.25, 0.5, 0.25};
  const auto blurred = [&](int column, int row) {
    double sum = 0;
    for (int j = -1; j <= 1; ++j) {
      for (int i = -1; i <= 1; ++i) sum += blur[i + 1] * blur[j + 1] * image(column + i, row + j);
    }
    return sum;
  };
  const double across = (blurred(x + 1, y) - blurred(x - 1, y)) / 2;
  const double down = (blurred(x, y + 1) - blurred(x, y - 1)) / 2;
  return {across * across, across * down, down * down};
}

// What one event makes of xx in an empty image, and as much of yy.
double of_single_event() {
  double sum = 0;
  for (int y = -4; y <= 4; ++y) {
    for (int x = -4; x <= 4; ++x)
      sum += products_at([](int column, int row) { return column == 0 && row == 0 ? 1.0 : 0.0; }, x, y).xx;
  }
  return sum;
}

const double single_event = of_single_event();

std::vector<StructureTensor> defined_tensors(const Points& points, Region plane, int block, int slices) {
  const auto width = static_cast<std::size_t>(plane.width), height = static_cast<std::size_t>(plane.height);
  const auto columns = (width + static_cast<std::size_t>(block) - 1) / static_cast<std::size_t>(block);
  const auto rows = (height + static_cast<std::size_t>(block) - 1) / static_cast<std::size_t>(block);
  std::vector<StructureTensor> tensors(columns * rows);
  const double start = double{points.dt.front()}, duration = double{points.dt.back()} - start;
  for (int slice = 0; slice < slices; ++slice) {
    std::vector<double> votes(width * height, 0.0);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const double share = duration > 0 ? (double{points.dt[k]} - start) / duration : 1;
      if (std::min(slices - 1, static_cast<int>(share * slices)) != slice) continue;
      const long x = std::lround(points.x[k]) - plane.x0, y = std::lround(points.y[k]) - plane.y0;
      if (x < 0 || y < 0 || x >= plane.width || y >= plane.height) continue;
      votes[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] +=
          points.sign.empty() ? 1.0 : double{points.sign[k]};
    }
    const Values image = [&](int x, int y) {
      if (x < 0 || y < 0 || x >= plane.width || y >= plane.height) return 0.0;
      return votes[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)];
    };
    for (int y = 0; y < plane.height; ++y) {
      for (int x = 0; x < plane.width; ++x) {
        const Products at = products_at(image, x, y);
        StructureTensor& tensor =
            tensors[static_cast<std::size_t>(y / block) * columns + static_cast<std::size_t>(x / block)];
        tensor.xx += at.xx;
        tensor.xy += at.xy;
        tensor.yy += at.yy;
      }
    }
  }
  // Events off the plane count for the blocks next to them.
  const BlockGrid grid = make_block_grid(points.view(), plane, block);
  for (std::size_t b = 0; b < tensors.size(); ++b) {
    tensors[b].single = single_event * grid.event_count[b];
    tensors[b].xx -= tensors[b].single;
    tensors[b].yy -= tensors[b].single;
  }
  return tensors;
}

// At times of -20..20 ms, sorted, on the plane and up to `off` px beside it.
Points random_points(std::mt19937& random, std::size_t count, Region plane, double off) {
  Points points;
  for (std::size_t k = 0; k < count; ++k) {
    points.x.push_back(static_cast<float>(plane.x0 + uniform(random, -off, plane.width - 1 + off)));
    points.y.push_back(static_cast<float>(plane.y0 + uniform(random, -off, plane.height - 1 + off)));
    points.dt.push_back(static_cast<float>(uniform(random, -0.02, 0.02)));
  }
  std::ranges::sort(points.dt);
  return points;
}

void add_point(Points& points, int x, int y, double dt = 0) {
  points.x.push_back(static_cast<float>(x));
  points.y.push_back(static_cast<float>(y));
  points.dt.push_back(static_cast<float>(dt));
}

// Of blocks of 8 px.
std::vector<EdgeDirection> directions_of(const Points& points, Region plane, double plain = 0.3,
                                         int slices = edge_slices) {
  const BlockGrid grid = make_block_grid(points.view(), plane, 8);
  return edge_directions(structure_tensors(points.view(), grid, slices), grid, plain);
}

bool is_none(EdgeDirection direction) { return direction.x == 0 && direction.y == 0; }

std::ptrdiff_t count_some(const std::vector<EdgeDirection>& directions) {
  return std::ranges::count_if(directions, [](EdgeDirection d) { return !is_none(d); });
}

// Rows for columns.
Points transposed(const Points& points) {
  Points swapped = points;
  std::swap(swapped.x, swapped.y);
  return swapped;
}

constexpr Region square{0, 0, 64, 64};

// A vertical line that drifts a pixel a slice from column 28 on, with an event in most of its rows in each.
Points drifting_line() {
  std::mt19937 random(4);
  Points points;
  for (int slice = 0; slice < edge_slices; ++slice) {
    for (int y = 0; y < 64; ++y) {
      if (random() % 8 != 0) add_point(points, 28 + slice, y, slice + y / 64.0);
    }
  }
  return points;
}

// `events` on every pixel of column 28 at once, from row 8 to row 55.
Points still_line(int events) {
  Points points;
  for (int y = 8; y < 56; ++y) {
    for (int i = 0; i < events; ++i) add_point(points, 28, y);
  }
  return points;
}

}  // namespace

TEST_CASE("a single event makes what follows by hand") {
  // Across (1 2 0 -2 -1)/8, down (1 2 1)/4.
  CHECK(single_event == doctest::Approx(10.0 / 64 * 6 / 16).epsilon(1e-12));
  // Taken away from it, nothing is left but for single events.
  Points points;
  add_point(points, 28, 28);
  const BlockGrid grid = make_block_grid(points.view(), square, 16);
  for (const int slices : {1, 6}) {
    const auto tensors = structure_tensors(points.view(), grid, slices);
    for (std::size_t b = 0; b < grid.count(); ++b) {
      CHECK(tensors[b].single == (b == 5 ? single_event : 0));
      CHECK(tensors[b].xx == 0);
      CHECK(tensors[b].xy == 0);
      CHECK(tensors[b].yy == 0);
    }
  }
}

TEST_CASE("structure tensors are those of their definition") {
  std::mt19937 random(1);
  for (const Region plane : {Region{0, 0, 64, 48}, {-7, 5, 45, 35}, {3, -9, 50, 20}, {0, 0, 7, 5}}) {
    for (const int block : {8, 16}) {
      for (const int slices : {1, 2, 6}) {
        for (const bool is_signed : {false, true}) {
          CAPTURE(plane.width);
          CAPTURE(block);
          CAPTURE(slices);
          CAPTURE(is_signed);
          // Several to a pixel, and some beside the plane.
          Points points = random_points(random, 600, plane, 6);
          if (is_signed) points.sign = random_signs(random, points.size());
          const BlockGrid grid = make_block_grid(points.view(), plane, block);
          const auto tensors = structure_tensors(points.view(), grid, slices);
          const auto expected = defined_tensors(points, plane, block, slices);
          REQUIRE(tensors.size() == expected.size());
          for (std::size_t b = 0; b < tensors.size(); ++b) {
            // Votes are whole and few enough for floats to hold all sums of them.
            CHECK(tensors[b].xx == doctest::Approx(expected[b].xx).epsilon(1e-9));
            CHECK(tensors[b].xy == doctest::Approx(expected[b].xy).epsilon(1e-9));
            CHECK(tensors[b].yy == doctest::Approx(expected[b].yy).epsilon(1e-9));
            CHECK(tensors[b].single == doctest::Approx(expected[b].single).epsilon(1e-9));
          }
        }
      }
    }
  }
}

TEST_CASE("events of one instant make one image, in however many slices") {
  std::mt19937 random(2);
  Points points = random_points(random, 300, square, 2);
  std::ranges::fill(points.dt, 0.01f);
  const BlockGrid grid = make_block_grid(points.view(), square, 8);
  const auto once = structure_tensors(points.view(), grid, 1),
             again = structure_tensors(points.view(), grid, 6);
  const auto expected = defined_tensors(points, square, 8, 6);
  for (std::size_t b = 0; b < grid.count(); ++b) {
    CHECK(again[b].xx == once[b].xx);
    CHECK(again[b].xy == once[b].xy);
    CHECK(again[b].yy == once[b].yy);
    CHECK(again[b].xx == doctest::Approx(expected[b].xx).epsilon(1e-9));
  }
}

TEST_CASE("events scattered at random come to nothing in the mean") {
  std::mt19937 random(3);
  for (const bool is_signed : {false, true}) {
    CAPTURE(is_signed);
    // Shares of what single events make, of windows of their own; without signs the plane's border is an
    // edge, so that events lie beside it and it is left out.
    std::vector<double> xx, xy, yy;
    for (int trial = 0; trial < 200; ++trial) {
      Points points = random_points(random, 1500, square, 0.499);
      if (is_signed) points.sign = random_signs(random, points.size());
      const BlockGrid grid = make_block_grid(points.view(), square, 16);
      const auto tensors = structure_tensors(points.view(), grid, edge_slices);
      StructureTensor sum;
      for (const std::size_t b : {5u, 6u, 9u, 10u}) sum.add(tensors[b]);
      xx.push_back(sum.xx / sum.single);
      xy.push_back(sum.xy / sum.single);
      yy.push_back(sum.yy / sum.single);
    }
    for (const auto& shares : {xx, xy, yy}) {
      double mean = 0, square_mean = 0;
      for (const double share : shares) {
        mean += share / static_cast<double>(shares.size());
        square_mean += share * share / static_cast<double>(shares.size());
      }
      const double error = std::sqrt((square_mean - mean * mean) / static_cast<double>(shares.size()));
      CHECK(error < 0.02);
      CHECK(std::abs(mean) < 3 * error);
    }
  }
}

TEST_CASE("directions are those of the eigenvectors of the tensors about a block") {
  std::mt19937 random(5);
  int straight = 0, bent = 0, none = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const BlockGrid grid = make_block_grid(
        Points{}.view(), {0, 0, 1 + static_cast<int>(random() % 60), 1 + static_cast<int>(random() % 40)}, 8);
    const double plain = uniform(random, 0, 1), many = uniform(random, 0.5, 10);
    const double way = uniform(random, 0, 6.3);
    std::vector<StructureTensor> tensors(grid.count());
    for (StructureTensor& tensor : tensors) {
      // Edges that mostly run one way, and what else there is.
      const double across = way + uniform(random, -0.5, 0.5), strong = uniform(random, 0, 1);
      const double other = uniform(random, -0.2, 0.3);
      tensor = {strong * std::cos(across) * std::cos(across) + other,
                strong * std::cos(across) * std::sin(across),
                strong * std::sin(across) * std::sin(across) + other, single_event * many};
    }
    const auto directions = edge_directions(tensors, grid, plain);
    REQUIRE(directions.size() == grid.count());
    for (int row = 0; row < grid.rows; ++row) {
      for (int column = 0; column < grid.columns; ++column) {
        Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
        double single = 0;
        for (int b = 0; b < static_cast<int>(grid.count()); ++b) {
          if (std::abs(b / grid.columns - row) > 1 || std::abs(b % grid.columns - column) > 1) continue;
          const StructureTensor& tensor = tensors[static_cast<std::size_t>(b)];
          sum += Eigen::Matrix2d{{tensor.xx, tensor.xy}, {tensor.xy, tensor.yy}};
          single += tensor.single;
        }
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(sum);  // the smaller one first
        const double least = std::max(0.0, solver.eigenvalues()[0]), most = solver.eigenvalues()[1];
        double length = 0;
        if (most > plain * single && single > 9.999 * single_event)
          length = std::max(0.0, 1 - 4 * least / most);
        const Eigen::Vector2d expected = length * solver.eigenvectors().col(0);
        const EdgeDirection direction = directions[static_cast<std::size_t>(row * grid.columns + column)];
        const Eigen::Vector2d found(direction.x, direction.y);
        REQUIRE(std::min((found - expected).norm(), (found + expected).norm()) < 1e-5);
        ++(length == 0 ? none : length == 1 ? straight : bent);
      }
    }
  }
  CHECK(straight > 100);
  CHECK(bent > 500);
  CHECK(none > 100);
}

TEST_CASE("a line that drifts slowly runs its own way, and nothing does elsewhere") {
  for (const bool across : {false, true}) {
    CAPTURE(across);
    const Points points = across ? transposed(drifting_line()) : drifting_line();
    const auto directions = directions_of(points, square);
    for (std::size_t row = 0; row < 8; ++row) {
      for (std::size_t column = 0; column < 8; ++column) {
        CAPTURE(row);
        CAPTURE(column);
        const EdgeDirection direction = directions[across ? column * 8 + row : row * 8 + column];
        // It goes through the fourth column of blocks and the fifth, and shows in those next to them.
        if (column < 2 || column > 5) {
          CHECK(is_none(direction));
          continue;
        }
        // The plane's border cuts it off.
        const bool at_end = row == 0 || row == 7;
        const float along = across ? direction.x : direction.y, aside = across ? direction.y : direction.x;
        CHECK(std::abs(along) > (at_end ? 0.5 : 0.9));
        CHECK(std::abs(along) < 1.001);
        CHECK(std::abs(aside) < 0.1);
      }
    }
  }
}

TEST_CASE("a line aslant runs aslant") {
  Points points;
  for (int y = 4; y < 60; ++y) {
    for (int i = 0; i < 3; ++i) add_point(points, y, 63 - y);
  }
  const auto directions = directions_of(points, square);
  for (std::size_t row = 1; row < 7; ++row) {
    const EdgeDirection direction = directions[row * 8 + 7 - row];
    CHECK(std::abs(direction.x) > 0.65);
    CHECK(direction.y == doctest::Approx(-direction.x).epsilon(0.05));
  }
}

TEST_CASE("texture that runs both ways has no direction") {
  Points checkers, dots, stripes;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      for (int i = 0; i < 3 && (x / 4 + y / 4) % 2 == 0; ++i) add_point(checkers, x, y);
      for (int i = 0; i < 3 && x % 4 == 0 && y % 4 == 0; ++i) add_point(dots, x, y);
      for (int i = 0; i < 3 && x / 4 % 2 == 0; ++i) add_point(stripes, x, y);
    }
  }
  for (const Points& points : {checkers, dots}) CHECK(count_some(directions_of(points, square)) == 0);
  // Stripes have: it is not for want of edges.
  CHECK(count_some(directions_of(stripes, square)) == 64);
}

TEST_CASE("few events have no direction, and no events none") {
  const auto line_of = [](int events) {
    Points points;
    for (int y = 0; y < events; ++y) add_point(points, 28, 25 + y / 2);
    return points;
  };
  CHECK(count_some(directions_of(line_of(9), square)) == 0);
  // All ten are in the block (3, 3), and about its neighbours.
  CHECK(count_some(directions_of(line_of(10), square)) == 9);
  // Five and five, of which only some blocks have all about them.
  Points apart;
  for (int i = 0; i < 5; ++i) add_point(apart, 28, 26 + i);
  for (int i = 0; i < 5; ++i) add_point(apart, 28, 42 + i);
  const auto directions = directions_of(apart, square);
  for (std::size_t b = 0; b < 64; ++b)
    CHECK(is_none(directions[b]) == !(b / 8 == 4 && b % 8 >= 2 && b % 8 <= 4));
  // None at all.
  const Points none;
  for (const Region plane : {square, Region{-3, 5, 20, 9}, Region{0, 0, 0, 0}}) {
    const BlockGrid grid = make_block_grid(none.view(), plane, 8);
    const auto tensors = structure_tensors(none.view(), grid, edge_slices);
    REQUIRE(tensors.size() == grid.count());
    for (const StructureTensor& tensor : tensors) {
      CHECK(tensor.xx == 0);
      CHECK(tensor.xy == 0);
      CHECK(tensor.yy == 0);
      CHECK(tensor.single == 0);
    }
    const auto of_none = edge_directions(tensors, grid, 0);
    CHECK(of_none.size() == grid.count());
    CHECK(count_some(of_none) == 0);
  }
}

TEST_CASE("what stands out less than is plain has no direction") {
  // Of n events a pixel, a line makes n^2 10/64 a row, and single events n 10/64 6/16.
  for (const int events : {1, 2, 3}) {
    CAPTURE(events);
    const Points points = still_line(events);
    const double stands_out = 8.0 / 3 * events - 1;
    const auto below = directions_of(points, square, stands_out - 0.01);
    const auto above = directions_of(points, square, stands_out + 0.01);
    // Away from its ends, which blocks next to them see too.
    for (std::size_t row = 3; row < 5; ++row) {
      for (std::size_t column = 2; column < 5; ++column) {
        CHECK(std::abs(below[row * 8 + column].y) == doctest::Approx(1));
        CHECK(std::abs(below[row * 8 + column].x) < 1e-6);
        CHECK(is_none(above[row * 8 + column]));
      }
    }
  }
}

TEST_CASE("what is turned by a right angle has directions turned by one") {
  std::mt19937 random(6);
  // A line and stray events of either sign, more of them above; on whole pixels, so that they turn into such.
  const Points line = drifting_line();
  Points points;
  for (std::size_t k = 0; k < line.size(); ++k) {
    points.push_back(line.view(), k);
    points.sign.push_back(1);
    if (k % 3 != 0) continue;
    const int x = static_cast<int>(random() % 64), y = static_cast<int>(random() % 64);
    add_point(points, x, k % 2 == 0 ? y : y / 2, double{line.dt[k]});
    points.sign.push_back(random() % 2 ? 1.0f : -1.0f);
  }
  Points turned = points;
  for (std::size_t k = 0; k < points.size(); ++k) {
    turned.x[k] = 63 - points.y[k];
    turned.y[k] = points.x[k];
  }
  const auto directions = directions_of(points, square), after = directions_of(turned, square);
  CHECK(count_some(directions) > 20);
  for (std::size_t row = 0; row < 8; ++row) {
    for (std::size_t column = 0; column < 8; ++column) {
      const EdgeDirection a = directions[row * 8 + column], b = after[column * 8 + 7 - row];
      // Whichever of the two ways along them.
      CHECK(std::abs(b.x * b.x - a.y * a.y) < 1e-5);
      CHECK(std::abs(b.y * b.y - a.x * a.x) < 1e-5);
      CHECK(std::abs(b.x * b.y + a.x * a.y) < 1e-5);
    }
  }
}
