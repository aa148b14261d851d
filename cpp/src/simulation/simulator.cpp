#include "emseg/simulation/simulator.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

#include "emseg/parallel.hpp"

namespace emseg::simulation {
namespace {

constexpr int tile_side = 32;  // px

std::vector<Region> tiles_of(ImageSize size) {
  std::vector<Region> tiles;
  for (int y = 0; y < size.height; y += tile_side) {
    for (int x = 0; x < size.width; x += tile_side) {
      tiles.push_back({x, y, std::min(tile_side, size.width - x), std::min(tile_side, size.height - y)});
    }
  }
  return tiles;
}

void check(const SimulationOptions& options) {
  const auto positive = [](const char* name, double value) {
    if (!std::isfinite(value) || !(value > 0)) {
      throw std::invalid_argument("simulation: " + std::string(name) + " is " + std::to_string(value) +
                                  ", expected a positive number");
    }
  };
  positive("duration", options.duration);
  positive("largest_motion", options.largest_motion);
  positive("largest_step", options.largest_step);
  positive("smallest_step", options.smallest_step);
  if (!(options.latency_jitter >= 0) || !(options.readout_interval >= 0)) {
    throw std::invalid_argument("simulation: expected latency_jitter and readout_interval of 0 s or more");
  }
}

// Steps through time as far as what the tile shows moves by no more than the bound.
class TileRun {
 public:
  TileRun(const Scene& scene, const SensorOptions& sensor, const SimulationOptions& options,
          const UndistortionTable& undistortion, Region tile)
      : scene_(scene), options_(options), renderer_(scene, undistortion, tile) {
    renderer_.render(0, now_);
    sensor_.emplace_back(scene, sensor, tile, now_);
  }

  std::vector<SimulatedEvent> run() {
    std::vector<SimulatedEvent> events;
    double t = 0, step = options_.smallest_step;
    while (t < options_.duration) {
      const double rest = options_.duration - t;
      step = std::min(step, rest);
      const bool changed = advance(t, step);
      // The time reached comes from the sum itself, so that successive intervals meet.
      const double reached = step == rest ? options_.duration : t + step;
      sensor_.front().expose(now_, changed ? next_ : now_, t, reached, events);
      if (changed) std::swap(now_, next_);
      t = reached;
      step = next_step_;
    }
    return events;
  }

 private:
  // Renders the end of a step into next_, shortening the step until its motion is within the bound.  False
  // where nothing has changed.
  bool advance(double t, double& step) {
    while (true) {
      if (!renderer_.render(t + step, next_, &now_)) {
        next_step_ = std::min(2 * step, options_.largest_step);
        return false;
      }
      // Everything in px of motion, so that one rule shortens the step.
      const double motion =
          std::max({renderer_.largest_motion(now_, next_), renderer_.largest_motion(next_, now_),
                    options_.largest_motion * renderer_.largest_passage(now_, next_) / largest_passage,
                    options_.largest_motion * lighting_change(step)});
      // Aim below the bound, so that a slight acceleration does not break it.
      const double aim = 0.9 * options_.largest_motion / std::max(motion, 1e-9);
      if (motion <= options_.largest_motion || step <= options_.smallest_step) {
        next_step_ = std::clamp(step * std::min(aim, 2.0), options_.smallest_step, options_.largest_step);
        return true;
      }
      step = std::max(step * std::min(aim, 0.5), options_.smallest_step);
    }
  }

  static constexpr double largest_passage = 8;            // px in a step, of what comes near the tile
  static constexpr double largest_lighting_change = 0.1;  // share of the brightness, in a step
  static constexpr double light_samples = 4;              // of a changing light, in a step

  // How much the light changes, 1 where it changes as much as it may in a step.
  double lighting_change(double step) const {
    double change = 0;
    for (std::size_t k = 0; k < now_.gains.size(); ++k) {
      const Light& light = scene_.lights[k];
      const double low = std::min(now_.gains[k], next_.gains[k]),
                   high = std::max(now_.gains[k], next_.gains[k]);
      if (light.gain.size() == 1 || (low == 1 && high == 1)) continue;
      change = std::max({change, (high - low) / std::max(high, 1e-9) / largest_lighting_change,
                         step / (light_samples * light.interval)});
    }
    return change;
  }

  const Scene& scene_;
  const SimulationOptions& options_;
  TileRenderer renderer_;
  std::vector<TileSensor> sensor_;  // one, made once the first picture is there
  TileImage now_, next_;
  double next_step_ = 0;
};

// Indices in the order of rising times, those of equal times as they are: digit by digit, least ones first.
std::vector<std::uint32_t> order_of(const std::vector<std::int64_t>& times) {
  constexpr int bits = 11;
  constexpr std::size_t digits = std::size_t{1} << bits;
  std::vector<std::uint32_t> order(times.size()), sorted(times.size());
  std::iota(order.begin(), order.end(), 0u);
  const std::int64_t last = times.empty() ? 0 : *std::max_element(times.begin(), times.end());
  for (int shift = 0; (last >> shift) > 0; shift += bits) {
    const auto digit = [&](std::uint32_t k) {
      return static_cast<std::size_t>(times[k] >> shift) & (digits - 1);
    };
    std::vector<std::uint32_t> place(digits + 1, 0);
    for (const std::uint32_t k : order) ++place[digit(k) + 1];
    std::partial_sum(place.begin(), place.end(), place.begin());
    for (const std::uint32_t k : order) sorted[place[digit(k)]++] = k;
    order.swap(sorted);
  }
  return order;
}

// Each event is stamped after its latency, in whole microseconds, one after the other on the bus.
SimulatedEvents read_out(const std::vector<SimulatedEvent>& all, const SimulationOptions& options,
                         const CounterRandom& random) {
  std::vector<std::int64_t> times;
  times.reserve(all.size());
  for (const SimulatedEvent& event : all) {
    double delay = 0;
    if (options.latency_jitter > 0) {
      const auto pixel = (static_cast<std::uint64_t>(event.y) << 32) + event.x;
      const auto nanosecond = static_cast<std::uint64_t>(std::llround(event.t * 1e9));
      delay = options.latency_jitter * random.exponential(pixel, nanosecond);
    }
    times.push_back(static_cast<std::int64_t>(std::floor((event.t + delay) * 1e6)));
  }
  SimulatedEvents events;
  events.x.reserve(all.size()), events.y.reserve(all.size()), events.t.reserve(all.size());
  events.p.reserve(all.size()), events.owner.reserve(all.size());
  double free_at = 0;  // us, when the bus has carried the event before
  for (const std::uint32_t k : order_of(times)) {
    std::int64_t t = times[k];
    if (options.readout_interval > 0) {
      free_at = std::max(free_at, static_cast<double>(t));
      t = static_cast<std::int64_t>(free_at);
      free_at += 1e6 * options.readout_interval;
    }
    events.x.push_back(all[k].x);
    events.y.push_back(all[k].y);
    events.t.push_back(t);
    events.p.push_back(all[k].p);
    events.owner.push_back(all[k].owner);
  }
  return events;
}

}  // namespace

SimulatedEvents simulate(const Scene& scene, const SensorOptions& sensor, const SimulationOptions& options) {
  check_scene(scene);
  check_sensor(sensor);
  check(options);
  const auto [width, height] = scene.camera.size;
  if (width > 4096 || height > 4096) {
    throw std::invalid_argument("simulation: the sensor has " + std::to_string(width) + "x" +
                                std::to_string(height) + " px, expected at most 4096 each way");
  }
  const UndistortionTable undistortion = make_undistortion_table(scene.camera);
  const std::vector<Region> tiles = tiles_of(scene.camera.size);
  std::vector<std::vector<SimulatedEvent>> parts(tiles.size());
  ThreadPool pool(options.threads);
  pool.for_each(tiles.size(), [&](std::size_t k, int) {
    parts[k] = TileRun(scene, sensor, options, undistortion, tiles[k]).run();
  });
  std::vector<SimulatedEvent> all;
  std::size_t count = 0;
  for (const auto& part : parts) count += part.size();
  all.reserve(count);
  for (auto& part : parts) {
    all.insert(all.end(), part.begin(), part.end());
    part = {};
  }
  return read_out(all, options, CounterRandom(sensor.seed + 1));
}

namespace {

// Writes what a tile shows into the truth of the whole image.
void copy_truth(const Scene& scene, const TileRenderer& renderer, const TileImage& image, double later,
                Truth& truth) {
  const Region tile = renderer.tile();
  std::vector<Pose> later_poses;
  for (const ProjectedSurface& seen : image.surfaces) {
    later_poses.push_back(renderer.camera_from_body(seen, later));
  }
  for (int row = 0; row < tile.height; ++row) {
    for (int column = 0; column < tile.width; ++column) {
      const auto local = static_cast<std::size_t>(row * tile.width + column);
      const auto p =
          static_cast<std::size_t>(tile.y0 + row) * static_cast<std::size_t>(scene.camera.size.width) +
          static_cast<std::size_t>(tile.x0 + column);
      truth.intensity[p] = image.intensity[local];
      int projected = image.front[local];
      if (const std::int32_t mixture = image.mixture[local]; mixture >= 0) {
        float largest = 0;
        const auto [begin, end] = image.mixtures[static_cast<std::size_t>(mixture)];
        for (int k = begin; k < end; ++k) {
          const Layer& layer = image.layers[static_cast<std::size_t>(k)];
          if (layer.weight > largest) largest = layer.weight, projected = layer.projected;
        }
      }
      if (projected < 0) continue;
      const ProjectedSurface& seen = image.surfaces[static_cast<std::size_t>(projected)];
      const Surface& surface = scene.surfaces[static_cast<std::size_t>(seen.surface)];
      truth.label[p] = static_cast<std::int16_t>(scene.bodies[static_cast<std::size_t>(surface.body)].label);
      const float x = renderer.local_x(column, row), y = renderer.local_y(column, row);
      truth.depth[p] = 1 / seen.w.at(x, y);
      const auto landing = renderer.land(seen, x, y, later_poses[static_cast<std::size_t>(projected)]);
      if (!landing.in_front) continue;
      const bool pinhole = scene.camera.model == DistortionModel::none;
      const Point2 there = pinhole ? landing.pixel : distort_pixel(scene.camera, landing.pixel);
      truth.flow_x[p] = static_cast<float>(there.x - (tile.x0 + column));
      truth.flow_y[p] = static_cast<float>(there.y - (tile.y0 + row));
    }
  }
}

}  // namespace

std::vector<Truth> render_truth(const Scene& scene, std::span<const double> moments, double interval,
                                int threads) {
  check_scene(scene);
  const UndistortionTable undistortion = make_undistortion_table(scene.camera);
  const ImageSize size = scene.camera.size;
  const std::size_t pixels = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  const Truth nothing{std::vector<float>(pixels), std::vector<std::int16_t>(pixels),
                      std::vector<float>(pixels), std::vector<float>(pixels, nan),
                      std::vector<float>(pixels, nan)};
  std::vector<Truth> truths(moments.size(), nothing);
  const std::vector<Region> tiles = tiles_of(size);
  ThreadPool pool(threads);
  pool.for_each(tiles.size(), [&](std::size_t k, int) {
    TileRenderer renderer(scene, undistortion, tiles[k]);
    TileImage image;
    for (std::size_t moment = 0; moment < moments.size(); ++moment) {
      renderer.render(moments[moment], image);
      copy_truth(scene, renderer, image, moments[moment] + interval, truths[moment]);
    }
  });
  return truths;
}

}  // namespace emseg::simulation
