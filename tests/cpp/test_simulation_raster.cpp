#include <doctest/doctest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "simulation_scenes.hpp"

using namespace emseg;
using namespace emseg::test;

namespace {

Truth truth_at(const Scene& scene, double t, double interval = 0.01) {
  const std::array<double, 1> moments{t};
  return render_truth(scene, moments, interval, 1).front();
}

}  // namespace

TEST_CASE("a sheet covers pixels by the share of them that it hides") {
  Scene scene = empty_scene(40, 30);
  add_sheet(scene, still_at({0, 0, 4}), 0, 20, 20, add_plain_texture(scene, 0.25));
  // Its left edge at x = 19.5 + 100 * (-0.1 + 0.0437) / 2 px and so on.
  add_sheet(scene, still_at({0.0437, -0.021, 2}), 1, 0.2, 0.1, add_plain_texture(scene, 1.0));
  const Truth truth = truth_at(scene, 0);
  const auto overlap = [](double pixel, double low, double high) {
    return std::max(0.0, std::min(pixel + 0.5, high) - std::max(pixel - 0.5, low));
  };
  const double x0 = 19.5 + 50 * (0.0437 - 0.1), y0 = 14.5 + 50 * (-0.021 - 0.05);
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) {
      const double share = overlap(x, x0, x0 + 10) * overlap(y, y0, y0 + 5);
      const auto p = static_cast<std::size_t>(y * 40 + x);
      CHECK(truth.intensity[p] == doctest::Approx(0.25 + 0.75 * share).epsilon(1e-4));
      if (std::abs(share - 0.5) > 0.01) CHECK(truth.label[p] == (share > 0.5 ? 1 : 0));
      if (std::abs(share - 0.5) > 0.01) CHECK(truth.depth[p] == doctest::Approx(share > 0.5 ? 2 : 4));
    }
  }
}

TEST_CASE("a bar thinner than a pixel takes its width") {
  Scene scene = empty_scene(32, 32);
  add_sheet(scene, still_at({0, 0, 4}), 0, 20, 20, add_plain_texture(scene, 0.2));
  add_sheet(scene, still_at({0.0021, 0, 1}), 0, 0.003, 10, add_plain_texture(scene, 1.0));  // 0.3 px wide
  const Truth truth = truth_at(scene, 0);
  double sum = 0;
  for (std::size_t x = 0; x < 32; ++x) sum += (truth.intensity[16 * 32 + x] - 0.2) / 0.8;
  CHECK(sum == doctest::Approx(0.3).epsilon(1e-3));
}

TEST_CASE("faces that meet at an edge leave no gap") {
  Scene scene = empty_scene(64, 64);
  add_sheet(scene, still_at({0, 0, 9}), 0, 90, 90, add_plain_texture(scene, 1.0));
  const int dark = add_plain_texture(scene, 0.1);
  // Two halves of one sheet, split along a slanted line.
  scene.bodies.push_back({still_at({0, 0, 2}), 1});
  for (const double side : {-1.0, 1.0}) {
    Surface half;
    half.body = 1;
    half.texture = dark;
    half.two_sided = true;
    half.outline.polygon = side < 0
                               ? std::vector<PlanePoint>{{-0.5, -0.5}, {0.1, -0.5}, {-0.13, 0.5}, {-0.5, 0.5}}
                               : std::vector<PlanePoint>{{0.1, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.13, 0.5}};
    scene.surfaces.push_back(half);
  }
  const Truth truth = truth_at(scene, 0);
  for (int y = 12; y < 52; ++y) {
    for (int x = 12; x < 52; ++x) CHECK(truth.intensity[static_cast<std::size_t>(y * 64 + x)] < 0.1001f);
  }
}

TEST_CASE("a needle ends at its tip") {
  Scene scene = empty_scene(64, 48);
  add_sheet(scene, still_at({0, 0, 9}), 0, 90, 90, add_plain_texture(scene, 1.0));
  add_sheet(scene, still_at({0.013, 0.017, 1}), 1, 1, 1, add_plain_texture(scene, 0.1));
  scene.surfaces.back().outline.polygon = {{-0.2, -0.01}, {0.1, 0}, {-0.2, 0.01}};  // 30 px long, 2 px wide
  const Truth truth = truth_at(scene, 0);
  const double tip = 31.5 + 100 * (0.013 + 0.1);
  double sum = 0;
  for (std::size_t y = 0; y < 48; ++y) {
    for (std::size_t x = 0; x < 64; ++x) {
      const double share = (1 - truth.intensity[y * 64 + x]) / 0.9;
      sum += share;
      if (static_cast<double>(x) > tip + 0.5) CHECK(share == doctest::Approx(0));
    }
  }
  CHECK(sum == doctest::Approx(30).epsilon(0.05));  // its area
}

TEST_CASE("the nearer of two crossing sheets is seen") {
  Scene scene = empty_scene(64, 48);
  add_sheet(scene, still_at({0, 0, 3}), 1, 20, 20, add_plain_texture(scene, 0.3));
  add_sheet(scene, still_at({0, 0, 3}), 2, 20, 20, add_plain_texture(scene, 0.6));
  scene.surfaces.back().axis_u = {0.8, 0, 0.6};  // recedes to the right
  const Truth truth = truth_at(scene, 0);
  for (std::size_t y = 0; y < 48; ++y) {
    for (std::size_t x = 0; x < 64; ++x) {
      const double ray = (static_cast<double>(x) - 31.5) / 100;
      CHECK(truth.label[y * 64 + x] == (ray < 0 ? 2 : 1));
      // On the slanted sheet z = 3 + 0.75 x and x = ray z.
      CHECK(truth.depth[y * 64 + x] == doctest::Approx(ray < 0 ? 3 / (1 - 0.75 * ray) : 3).epsilon(1e-5));
    }
  }
}

TEST_CASE("one-sided surfaces are seen from where their normal points") {
  Scene scene = empty_scene(16, 16);
  add_sheet(scene, still_at({0, 0, 4}), 1, 20, 20, add_plain_texture(scene, 0.3));
  scene.surfaces.back().two_sided = false;
  CHECK(truth_at(scene, 0).depth[100] == 0);  // cross(u, v) points away from the camera
  scene.surfaces.back().axis_v = {0, -1, 0};
  CHECK(truth_at(scene, 0).depth[100] == doctest::Approx(4));
}

TEST_CASE("flow is where things go, and depends on the depth") {
  Scene scene = empty_scene(64, 48);
  add_sheet(scene, still_at({0, 0, 5}), 0, 40, 40, add_plain_texture(scene, 0.3));
  add_sheet(scene, straight({0, 0, 2}, {1, -0.5, 0}), 1, 0.3, 0.3, add_plain_texture(scene, 0.6));
  scene.T_world_camera = straight({0, 0, 0}, {0.5, 0, 0});
  const Truth truth = truth_at(scene, 0.1, 0.02);
  int objects = 0;
  for (std::size_t p = 0; p < truth.label.size(); ++p) {
    const bool moves = truth.label[p] == 1;
    objects += moves;
    CHECK(truth.flow_x[p] ==
          doctest::Approx(moves ? 100 * 0.5 * 0.02 / 2 : -100 * 0.5 * 0.02 / 5).epsilon(1e-4));
    CHECK(truth.flow_y[p] == doctest::Approx(moves ? -100 * 0.5 * 0.02 / 2 : 0).epsilon(1e-4));
  }
  CHECK(objects == doctest::Approx(15 * 15).epsilon(0.1));
}

TEST_CASE("scenes that are not sound are refused, naming the surface") {
  Scene scene = empty_scene(16, 16);
  add_sheet(scene, still_at({0, 0, 4}), 1, 20, 20, add_plain_texture(scene, 0.3));
  const auto complaint = [&] {
    try {
      check_scene(scene);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(complaint() == "");
  SUBCASE("polygon") {
    std::swap(scene.surfaces[0].outline.polygon[0], scene.surfaces[0].outline.polygon[1]);
    CHECK(complaint().find("surface 0: its corners make no convex polygon") == 0);
  }
  SUBCASE("texture") {
    scene.surfaces[0].texture = 1;
    CHECK(complaint() == "surface 0: there is no texture 1");
  }
  SUBCASE("axes") {
    scene.surfaces[0].axis_v = {1, 1, 0};
    CHECK(complaint().find("axes") != std::string::npos);
  }
  SUBCASE("lights") {
    scene.lights.clear();
    CHECK(complaint().find("lights") != std::string::npos);
  }
}
