#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "emseg/background.hpp"
#include "emseg/iwe.hpp"
#include "synthetic_events.hpp"

using namespace emseg;
using namespace emseg::testing;

namespace {

struct LabelledPoints {
  Points points;
  std::vector<std::int32_t> labels;

  // `count` events of a label somewhere in the 16 px tile of this column and row.
  void fill(int column, int row, std::int32_t label, int count = 3) {
    for (int i = 0; i < count; ++i) {
      points.x.push_back(static_cast<float>(16 * column + 5 * i % 16));
      points.y.push_back(static_cast<float>(16 * row + 3 * i % 16));
      points.dt.push_back(0);
      labels.push_back(label);
    }
  }
  std::vector<LabelExtent> extents(std::int32_t label_count, Region plane) const {
    return label_extents(points.view(), labels, label_count, plane);
  }
};

}  // namespace

TEST_CASE("a label all over the scene has all its tiles and the spread of it all") {
  LabelledPoints all;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 5; ++column) all.fill(column, row, 1);
  }
  const auto extents = all.extents(3, {0, 0, 80, 48});
  CHECK(extents[1].tiles == 15);
  CHECK(extents[1].share == doctest::Approx(1));
  CHECK(extents[1].spread == doctest::Approx(1));
  for (const std::size_t unused : {0u, 2u}) {
    CHECK(extents[unused].tiles == 0);
    CHECK(extents[unused].share == 0);
    CHECK(extents[unused].spread == 0);
  }
}

TEST_CASE("extents by hand") {
  LabelledPoints some;
  some.fill(1, 2, 0);     // one tile of label 0
  some.fill(0, 0, 1, 4);  // the corners of a 4 x 4 square for label 1
  some.fill(3, 0, 1, 4);
  some.fill(0, 3, 1, 4);
  some.fill(3, 3, 1, 4);
  some.fill(2, 2, 1, 2);  // too few
  some.fill(1, 1, 1, 3);  // in the minority
  some.fill(1, 1, 0, 4);
  some.fill(0, 0, -1, 9);                                // noise holds no tile
  const auto extents = some.extents(2, {0, 0, 61, 64});  // the last column is narrower: 4 x 4 tiles
  CHECK(extents[0].tiles == 2);
  CHECK(extents[0].share == doctest::Approx(2.0 / 16));
  // Rows 1 and 2, column 1: variance 1/12 across and 1/4 + 1/12 down; tiles all over have 16/12 either way.
  CHECK(extents[0].spread == doctest::Approx(std::sqrt((1.0 / 12) * (4.0 / 12)) / (16.0 / 12)));
  CHECK(extents[1].tiles == 4);
  // Corners: variance 9/4 + 1/12 either way.
  CHECK(extents[1].spread == doctest::Approx((28.0 / 12) / (16.0 / 12)));
}

TEST_CASE("tiles on a diagonal have little spread") {
  LabelledPoints line;
  for (int i = 0; i < 6; ++i) line.fill(i, i, 0);
  // Variances and covariance of 0..5 are 35/12; with 1/12 within the tile the determinant is (36^2 -
  // 35^2)/144.
  CHECK(line.extents(1, {0, 0, 96, 96})[0].spread ==
        doctest::Approx(std::sqrt(36.0 * 36 - 35 * 35) / 12 / (36.0 / 12)));
}

TEST_CASE("no labels, no events, events beyond the plane") {
  LabelledPoints nothing;
  CHECK(nothing.extents(0, {0, 0, 80, 48}).empty());
  CHECK(nothing.extents(2, {0, 0, 80, 48})[1].tiles == 0);
  nothing.fill(9, 9, 0);  // counts for the nearest tile
  CHECK(nothing.extents(1, {0, 0, 80, 48})[0].tiles == 1);
}

TEST_CASE("the background is the label with most tiles among those that span the scene") {
  const auto of = [](std::vector<LabelExtent> extents) { return background_label(extents); };
  CHECK(of({}) == -1);
  CHECK(of({{50, 0.3, 0.6}, {60, 0.35, 0.5}}) == 1);
  CHECK(of({{50, 0.3, 0.6}, {90, 0.4, 0.1}}) == 0);   // the other is large but in one place
  CHECK(of({{9, 0.05, 0.9}, {8, 0.08, 0.1}}) == -1);  // far apart but next to nothing; and compact
  CHECK(of({{20, 0.2, 0.5}, {20, 0.2, 0.5}}) == 0);
}

TEST_CASE("lonely events are those that brute force finds") {
  const WarpFrame frame = make_warp_frame({48, 40});
  const Region plane{0, 0, 48, 40};
  const std::vector<MotionModel> models{Translation{{120, -80}}, Similarity{{-60, 90, 0.4, 0.5}},
                                        Translation{{5000, 0}}};
  for (const auto& [company, radius] : {std::pair{0, 1}, {1, 1}, {2, 1}, {4, 1}, {1, 2}, {3, 2}}) {
    CAPTURE(company);
    CAPTURE(radius);
    std::mt19937 random(static_cast<std::uint32_t>(company));
    Points points;
    std::vector<std::int32_t> labels;
    for (int k = 0; k < 500; ++k) {
      points.x.push_back(static_cast<float>(std::floor(uniform(random, 0, 48))));
      points.y.push_back(static_cast<float>(std::floor(uniform(random, 0, 40))));
      points.dt.push_back(static_cast<float>(uniform(random, -0.03, 0.03)));
      labels.push_back(static_cast<std::int32_t>(random() % 4) - 1);
    }
    const auto lonely = find_lonely_events(points.view(), labels, models, frame, plane, company, radius);
    const Region canvas = canvas_of(plane);
    std::vector<long> x, y;
    for (std::size_t k = 0; k < points.size(); ++k) {
      Place at{};
      if (labels[k] >= 0) {
        at = reference_warp(models[static_cast<std::size_t>(labels[k])], frame, {points.x[k], points.y[k]},
                            points.dt[k]);
      }
      x.push_back(std::lround(at.x));
      y.push_back(std::lround(at.y));
    }
    const auto followed = [&](std::size_t k) {
      return x[k] >= canvas.x0 && y[k] >= canvas.y0 && x[k] < canvas.x0 + canvas.width &&
             y[k] < canvas.y0 + canvas.height;
    };
    for (std::size_t k = 0; k < points.size(); ++k) {
      int near = 0;
      for (std::size_t other = 0; other < points.size(); ++other) {
        near += other != k && labels[other] == labels[k] && followed(other) &&
                std::labs(x[other] - x[k]) <= radius && std::labs(y[other] - y[k]) <= radius;
      }
      CAPTURE(k);
      REQUIRE(static_cast<int>(lonely[k]) == (labels[k] >= 0 && followed(k) && near < company));
    }
  }
}

TEST_CASE("company is looked for further where events are few: one in nine pixels is the bound") {
  const Region plane{-2, 3, 60, 30};
  CHECK(company_radius(1800, plane) == 1);
  CHECK(company_radius(200, plane) == 1);
  CHECK(company_radius(199, plane) == 2);
  CHECK(company_radius(1, plane) == 2);
  CHECK(company_radius(0, plane) == 2);
}
