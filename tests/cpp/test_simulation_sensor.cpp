#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>

#include "simulation_scenes.hpp"

using namespace emseg;
using namespace emseg::test;

namespace {

constexpr int side = 32;
constexpr double pixels = side * side;

// A plain wall of intensity 0.5 under one light.
Scene plain_wall(Light light = {}) {
  Scene scene = empty_scene(side, side);
  scene.lights = {std::move(light)};
  add_sheet(scene, still_at({0, 0, 2}), 0, 20, 20, add_plain_texture(scene, 0.5));
  return scene;
}

SimulatedEvents run(const Scene& scene, const SensorOptions& sensor, double duration, int threads = 1) {
  SimulationOptions options;
  options.duration = duration;
  options.threads = threads;
  return simulate(scene, sensor, options);
}

// Light that falls by a factor exp(-rate) a second.
Light fading(double rate) {
  Light light;
  light.interval = 1e-3;
  light.gain.clear();
  for (int k = 0; k <= 1000; ++k) light.gain.push_back(static_cast<float>(std::exp(-rate * 1e-3 * k)));
  return light;
}

}  // namespace

TEST_CASE("a still scene without noise makes no event") {
  CHECK(run(plain_wall(), ideal_sensor(0.2), 1).t.empty());
  Scene textured = empty_scene(64, 48);
  add_sheet(textured, still_at({0, 0, 2}), 0, 20, 20, add_leaves(textured, 1));
  SensorOptions slow = ideal_sensor(0.05);
  slow.cutoff = 100;
  slow.threshold_sigma = 0.02;
  CHECK(run(textured, slow, 1).t.empty());
}

TEST_CASE("events count the contrast in thresholds and come when it is reached") {
  const double rate = 3.1, threshold = 0.2;
  const SimulatedEvents events = run(plain_wall(fading(rate)), ideal_sensor(threshold), 0.9);
  std::map<int, std::vector<std::int64_t>> times;
  for (std::size_t k = 0; k < events.t.size(); ++k) {
    CHECK(events.p[k] == 0);
    CHECK(events.owner[k] == 0);
    times[events.y[k] * side + events.x[k]].push_back(events.t[k]);
  }
  // The first takes from nothing to the two thresholds between a rise and a fall, one on average.
  const double expected = 0.9 * rate / threshold - 0.5;
  CHECK(static_cast<double>(events.t.size()) / pixels == doctest::Approx(expected).epsilon(0.01));
  for (const auto& [pixel, t] : times) {
    CHECK(std::abs(static_cast<double>(t.size()) - expected) <= 1.5);
    for (std::size_t k = 1; k < t.size(); ++k) {
      CHECK(1e-6 * static_cast<double>(t[k] - t[k - 1]) == doctest::Approx(threshold / rate).epsilon(0.01));
    }
  }
}

TEST_CASE("thresholds differ between pixels as asked") {
  SensorOptions sensor = ideal_sensor(0.2);
  sensor.threshold_sigma = 0.02;
  const SimulatedEvents events = run(plain_wall(fading(6)), sensor, 1);
  std::map<int, double> counts;
  for (std::size_t k = 0; k < events.t.size(); ++k) counts[events.y[k] * side + events.x[k]] += 1;
  double sum = 0, squares = 0;
  for (const auto& [pixel, count] : counts) sum += 6 / count, squares += 36 / count / count;
  const double mean = sum / pixels, sigma = std::sqrt(squares / pixels - mean * mean);
  CHECK(mean == doctest::Approx(0.2).epsilon(0.02));
  CHECK(sigma == doctest::Approx(0.02).epsilon(0.15));
}

TEST_CASE("shot noise, leak and hot pixels come at the rates asked for") {
  SensorOptions sensor = ideal_sensor(0.25);
  const auto rate = [&](double duration) {
    const SimulatedEvents events = run(plain_wall(), sensor, duration);
    for (const std::int16_t owner : events.owner) CHECK(owner == -1);
    return static_cast<double>(events.t.size()) / pixels / duration;
  };
  SUBCASE("shot noise, less where it is bright") {
    sensor.shot_noise = 8;
    sensor.shot_noise_bright = 0.25;
    const double expected = 8 * (1 - 0.75 * 0.5);
    CHECK(rate(4) == doctest::Approx(expected).epsilon(4 / std::sqrt(4 * pixels * expected)));
  }
  SUBCASE("much shot noise in few steps") {
    sensor.shot_noise = 400;
    sensor.shot_noise_bright = 1;
    CHECK(rate(0.2) == doctest::Approx(400).epsilon(4 / std::sqrt(80 * pixels)));
  }
  SUBCASE("leak") {
    sensor.leak = 2;
    sensor.leak_sigma = 0.2;
    const SimulatedEvents events = run(plain_wall(), sensor, 4);
    CHECK(std::count(events.p.begin(), events.p.end(), 1) == static_cast<int>(events.p.size()));
    // Once all pixels are in the rhythm of their leak.
    const auto settled =
        std::count_if(events.t.begin(), events.t.end(), [](auto t) { return t >= 1'500'000; });
    CHECK(static_cast<double>(settled) / pixels / 2.5 == doctest::Approx(2).epsilon(0.02));
  }
  SUBCASE("hot pixels") {
    sensor.hot_fraction = 0.1;
    sensor.hot_rate = 50;
    CHECK(rate(2) == doctest::Approx(5).epsilon(0.25));
  }
  SUBCASE("both polarities alike") {
    sensor.shot_noise = 8;
    const SimulatedEvents events = run(plain_wall(), sensor, 2);
    const auto rises = static_cast<double>(std::count(events.p.begin(), events.p.end(), 1));
    const auto count = static_cast<double>(events.p.size());
    CHECK(rises / count == doctest::Approx(0.5).epsilon(4 / std::sqrt(count)));
  }
}

TEST_CASE("a pixel rests after an event, and follows meanwhile") {
  SensorOptions sensor = ideal_sensor(0.2);
  sensor.refractory = 0.03;
  const double rate = 10;  // a threshold every 0.02 s
  const SimulatedEvents events = run(plain_wall(fading(rate)), sensor, 0.9);
  std::map<int, std::int64_t> last;
  for (std::size_t k = 0; k < events.t.size(); ++k) {
    const int pixel = events.y[k] * side + events.x[k];
    if (last.contains(pixel)) {
      // Rest, then a whole threshold again.
      CHECK(1e-6 * static_cast<double>(events.t[k] - last[pixel]) == doctest::Approx(0.05).epsilon(0.01));
    }
    last[pixel] = events.t[k];
  }
}

TEST_CASE("the low pass delays a step of light by its time constant") {
  Light step;
  step.interval = 1e-4;
  step.gain.assign(2001, 1.0f);
  for (std::size_t k = 1000; k < step.gain.size(); ++k) step.gain[k] = 0.5f;
  SensorOptions sensor = ideal_sensor(0.05);
  sensor.cutoff = 10;
  const SimulatedEvents events = run(plain_wall(step), sensor, 0.2);
  // Behind the step intensity is 0.25, the pace 2 pi 10 Hz 0.25; the level falls by log 2 (1 - exp(-pace t)).
  const double pace = 2 * 3.14159265 * 10 * 0.25;
  double sum = 0;
  for (const std::int64_t t : events.t) {
    CHECK(t >= 99'000);
    sum += 1;
  }
  const double fallen = std::log(2) * (1 - std::exp(-pace * 0.1));
  CHECK(sum / pixels == doctest::Approx(fallen / 0.05 - 0.5).epsilon(0.01));
  const double half = 100'000 + 1e6 * std::log(2) / pace;  // by then half of log 2 has passed
  const auto before =
      std::count_if(events.t.begin(), events.t.end(), [&](auto t) { return double(t) < half; });
  CHECK(static_cast<double>(before) / pixels == doctest::Approx(std::log(2) / 2 / 0.05 - 0.5).epsilon(0.01));
}

TEST_CASE("events are the same for any number of threads, and others for another seed") {
  Scene scene = empty_scene(100, 70);
  add_sheet(scene, straight({0, 0, 3}, {0.3, 0.1, 0}), 0, 40, 40, add_leaves(scene, 1));
  add_sheet(scene, straight({-0.3, 0, 2}, {1.5, 0, 0}), 1, 0.4, 0.4, add_leaves(scene, 2));
  SensorOptions sensor;
  sensor.shot_noise = 2;
  sensor.leak = 1;
  sensor.cutoff = 300;
  const SimulatedEvents one = run(scene, sensor, 0.1, 1), three = run(scene, sensor, 0.1, 3);
  REQUIRE(one.t.size() > 1000);
  CHECK((one.t == three.t && one.x == three.x && one.y == three.y && one.p == three.p &&
         one.owner == three.owner));
  CHECK(std::is_sorted(one.t.begin(), one.t.end()));
  sensor.seed = 1;
  CHECK(run(scene, sensor, 0.1).t != one.t);
}

TEST_CASE("readout delays by the latency asked for and keeps events apart") {
  SensorOptions sensor = ideal_sensor(0.2);
  const Scene scene = plain_wall(fading(3));
  SimulationOptions options;
  options.duration = 0.5;
  const SimulatedEvents prompt = simulate(scene, sensor, options);
  options.latency_jitter = 2e-4;
  const SimulatedEvents late = simulate(scene, sensor, options);
  REQUIRE(prompt.t.size() == late.t.size());
  double sum = 0;
  for (std::size_t k = 0; k < late.t.size(); ++k) sum += static_cast<double>(late.t[k] - prompt.t[k]);
  CHECK(sum / static_cast<double>(late.t.size()) == doctest::Approx(200).epsilon(0.05));
  CHECK(std::is_sorted(late.t.begin(), late.t.end()));
  options.latency_jitter = 0;
  options.readout_interval = 100e-6;
  const SimulatedEvents slow = simulate(scene, sensor, options);
  for (std::size_t k = 1; k < slow.t.size(); ++k) CHECK(slow.t[k] - slow.t[k - 1] >= 99);
}

TEST_CASE("settings that make no sensor are named") {
  const Scene scene = plain_wall();
  const auto complaint = [&](auto change) {
    SensorOptions sensor;
    change(sensor);
    try {
      run(scene, sensor, 0.01);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(complaint([](auto&) {}) == "");
  CHECK(complaint([](auto& o) { o.threshold_on = 0; }).find("threshold_on is 0") != std::string::npos);
  CHECK(complaint([](auto& o) { o.refractory = -1; }).find("refractory is -1") != std::string::npos);
  CHECK(complaint([](auto& o) { o.hot_fraction = 2; }).find("hot_fraction is 2") != std::string::npos);
}
