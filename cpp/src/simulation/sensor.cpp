#include "emseg/simulation/sensor.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "emseg/simulation/numeric.hpp"

namespace emseg::simulation {
namespace {

// Draws of a pixel: the first ones are spoken for.
enum Draw : std::uint64_t {
  on_threshold = 0,
  off_threshold = 3,
  phase = 6,
  hot = 7,
  hot_share = 8,
  leak = 9,
  events = 12
};

void check(const char* name, double value, bool sound, const char* expected) {
  if (!sound) {
    throw std::invalid_argument("sensor: " + std::string(name) + " is " + std::to_string(value) +
                                ", expected " + expected);
  }
}

// One surface's part in a pixel before and after; absent is a part of weight 0 with the colour of the other.
struct Part {
  int surface;  // in the scene, -1: sky
  float inverse_depth;
  std::array<float, 2> weight, intensity;
};

constexpr std::size_t most_parts = 24;

struct Parts {
  std::array<Part, most_parts> items;
  std::size_t count = 0;

  void add(int side, int surface, float weight, float intensity, float inverse_depth) {
    const auto s = static_cast<std::size_t>(side);
    for (std::size_t k = 0; k < count; ++k) {
      Part& part = items[k];
      if (part.surface != surface) continue;
      part.weight[s] += weight;
      part.intensity[s] = intensity;
      part.inverse_depth = std::max(part.inverse_depth, inverse_depth);
      return;
    }
    if (count == most_parts) return;
    Part part{surface, inverse_depth, {0, 0}, {intensity, intensity}};
    part.weight[s] = weight;
    items[count++] = part;
  }

  void add(int side, const TileImage& image, std::size_t pixel) {
    const auto name = [&](int projected) {
      return projected < 0 ? -1 : image.surfaces[static_cast<std::size_t>(projected)].surface;
    };
    const std::int32_t mixture = image.mixture[pixel];
    if (mixture < 0) {
      add(side, name(image.front[pixel]), 1, image.intensity[pixel], image.inverse_depth[pixel]);
      return;
    }
    const auto [begin, end] = image.mixtures[static_cast<std::size_t>(mixture)];
    for (int k = begin; k < end; ++k) {
      const Layer& layer = image.layers[static_cast<std::size_t>(k)];
      add(side, name(layer.projected), layer.weight, layer.intensity, layer.inverse_depth);
    }
  }
};

int label_of(const Scene& scene, int surface) {
  if (surface < 0) return 0;
  const int body = scene.surfaces[static_cast<std::size_t>(surface)].body;
  return scene.bodies[static_cast<std::size_t>(body)].label;
}

int front_label(const Scene& scene, const TileImage& image, std::size_t pixel) {
  const int projected = image.front[pixel];
  return projected < 0 ? 0 : label_of(scene, image.surfaces[static_cast<std::size_t>(projected)].surface);
}

}  // namespace

void check_sensor(const SensorOptions& options) {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  const auto not_negative = [](double value) { return std::isfinite(value) && value >= 0; };
  const auto share = [](double value) { return value >= 0 && value <= 1; };
  check("threshold_on", options.threshold_on, positive(options.threshold_on), "a positive number");
  check("threshold_off", options.threshold_off, positive(options.threshold_off), "a positive number");
  check("threshold_sigma", options.threshold_sigma, not_negative(options.threshold_sigma), "0 or more");
  check("refractory", options.refractory, not_negative(options.refractory), "0 s or more");
  check("cutoff", options.cutoff, not_negative(options.cutoff), "0 Hz or more");
  check("dark_intensity", options.dark_intensity, positive(options.dark_intensity), "a positive number");
  check("shot_noise", options.shot_noise, not_negative(options.shot_noise), "0 Hz or more");
  check("shot_noise_bright", options.shot_noise_bright, share(options.shot_noise_bright), "0..1");
  check("leak", options.leak, not_negative(options.leak), "0 Hz or more");
  check("leak_sigma", options.leak_sigma, share(options.leak_sigma), "0..1");
  check("hot_fraction", options.hot_fraction, share(options.hot_fraction), "0..1");
  check("hot_rate", options.hot_rate, not_negative(options.hot_rate), "0 Hz or more");
}

// The intensity of a pixel is, from front to back, I_k = a_k c_k + (1 - a_k) I_{k+1}, with colours c and
// shares a of what the surfaces in front leave.  To first order its change is a sum over surfaces of r_k
// (da_k (c_k - I_{k+1}) + a_k dc_k), r_k what is left of the pixel in front of k: the change that surface k
// makes alone.
int responsible_label(const Scene& scene, const TileImage& before, const TileImage& after, std::size_t pixel,
                      int direction) {
  Parts parts;
  parts.add(0, before, pixel);
  parts.add(1, after, pixel);
  if (parts.count == 1) return label_of(scene, parts.items[0].surface);
  std::stable_sort(parts.items.begin(), parts.items.begin() + static_cast<std::ptrdiff_t>(parts.count),
                   [](const Part& a, const Part& b) { return a.inverse_depth > b.inverse_depth; });
  // Intensity of what lies behind each part, before and after.  Where nothing is seen of it on one side, what
  // is seen on the other counts, and where on neither, the part's own.
  std::array<std::array<float, 2>, most_parts> behind{};
  std::array<float, 2> weight{}, sum{};
  for (std::size_t k = parts.count; k-- > 0;) {
    const Part& part = parts.items[k];
    for (std::size_t side = 0; side < 2; ++side) {
      const std::size_t seen = weight[side] > 1e-6f ? side : 1 - side;
      behind[k][side] = weight[seen] > 1e-6f ? sum[seen] / weight[seen] : part.intensity[side];
    }
    for (std::size_t side = 0; side < 2; ++side) {
      weight[side] += part.weight[side];
      sum[side] += part.weight[side] * part.intensity[side];
    }
  }
  std::array<std::pair<int, float>, most_parts> change{};  // by label
  std::size_t labels = 0;
  std::array<float, 2> left{1, 1};
  for (std::size_t k = 0; k < parts.count; ++k) {
    const Part& part = parts.items[k];
    std::array<float, 2> share{};
    for (std::size_t side = 0; side < 2; ++side) {
      share[side] = left[side] > 1e-6f ? std::min(part.weight[side] / left[side], 1.0f) : 1.0f;
    }
    const float colour = (part.intensity[0] + part.intensity[1]) / 2;
    const float under = (behind[k][0] + behind[k][1]) / 2;
    const float own = (left[0] + left[1]) / 2 *
                      ((share[1] - share[0]) * (colour - under) +
                       (share[0] + share[1]) / 2 * (part.intensity[1] - part.intensity[0]));
    const int label = label_of(scene, part.surface);
    std::size_t place = 0;
    while (place < labels && change[place].first != label) ++place;
    if (place == labels) change[labels++] = {label, 0.0f};
    change[place].second += own;
    for (std::size_t side = 0; side < 2; ++side) left[side] = std::max(0.0f, left[side] - part.weight[side]);
  }
  std::size_t best = 0;
  const auto sign = static_cast<float>(direction);
  for (std::size_t k = 1; k < labels; ++k) {
    if (sign * change[k].second > sign * change[best].second) best = k;
  }
  return change[best].first;
}

TileSensor::TileSensor(const Scene& scene, const SensorOptions& options, Region tile, const TileImage& first)
    : scene_(scene),
      options_(options),
      random_(options.seed),
      tile_(tile),
      shot_noise_dark_(static_cast<float>(options.shot_noise)),
      shot_noise_fading_(static_cast<float>(options.shot_noise * (1 - options.shot_noise_bright))) {
  const std::size_t count = tile.area();
  assert(first.intensity.size() == count);
  const auto dark = static_cast<float>(options.dark_intensity);
  const double least_threshold = 0.1 * std::min(options.threshold_on, options.threshold_off);
  for (std::size_t k = 0; k < count; ++k) {
    const std::uint64_t stream = stream_of(k);
    const auto threshold = [&](double mean, Draw draw) {
      return std::max(least_threshold, mean + options.threshold_sigma * random_.normal(stream, draw));
    };
    const double on = threshold(options.threshold_on, Draw::on_threshold);
    const double off = threshold(options.threshold_off, Draw::off_threshold);
    const double leak_rate =
        options.leak * std::max(0.0, 1 + options.leak_sigma * random_.normal(stream, Draw::leak));
    const bool is_hot = random_.uniform(stream, Draw::hot) <= options.hot_fraction;
    const double log_intensity = fast_log(first.intensity[k] + dark);
    threshold_on_.push_back(static_cast<float>(on));
    threshold_off_.push_back(static_cast<float>(off));
    leak_.push_back(static_cast<float>(leak_rate * on));
    hot_rate_.push_back(
        is_hot ? static_cast<float>(options.hot_rate * 2 * random_.uniform(stream, Draw::hot_share)) : 0.0f);
    log_.push_back(static_cast<float>(log_intensity));
    // Each pixel starts somewhere between two reports; from the same place all would fire together.
    const double share = 0.98 * random_.uniform(stream, Draw::phase) + 0.01;
    reported_.push_back(static_cast<float>(log_intensity - on + share * (on + off)));
    cause_.push_back(static_cast<std::int16_t>(front_label(scene, first, k)));
  }
  level_ = anchor_ = log_;
  exposure_.assign(count, 0.0f);
  awake_.assign(count, first.seconds);
  last_report_.assign(count, first.seconds);
  draws_.assign(count, 0);
  next_log_.resize(count);
  next_level_.resize(count);
  stirred_.resize(count);
  for (std::size_t k = 0; k < count; ++k) patience_.push_back(static_cast<float>(draw_patience(k)));
}

std::uint64_t TileSensor::stream_of(std::size_t pixel) const {
  const auto width = static_cast<std::size_t>(tile_.width);
  return ((static_cast<std::uint64_t>(tile_.y0) + pixel / width) << 32) +
         static_cast<std::uint64_t>(tile_.x0) + pixel % width;
}

double TileSensor::draw_patience(std::size_t pixel) {
  return random_.exponential(stream_of(pixel), Draw::events + 2 * std::uint64_t{draws_[pixel]++});
}

void TileSensor::expose(const TileImage& before, const TileImage& after, double from, double to,
                        std::vector<SimulatedEvent>& events) {
  const std::size_t count = tile_.area();
  const auto seconds = static_cast<float>(to - from);
  const bool changed = &before != &after, filters = options_.cutoff > 0;
  if (changed || filters) filter(before, after, seconds);
  const float* next_level = changed || filters ? next_level_.data() : level_.data();
  const float* intensity = after.intensity.data();
  // The loop over all pixels is plain, so that it vectorises; what needs care is done for the few it finds.
  for (std::size_t k = 0; k < count; ++k) {
    reported_[k] -= leak_[k] * seconds;
    exposure_[k] += seconds * noise_rate(k, intensity[k]);
    const float difference = next_level[k] - reported_[k];
    const bool rises = difference >= threshold_on_[k], falls = -difference >= threshold_off_[k];
    stirred_[k] = static_cast<std::uint8_t>(rises | falls | (exposure_[k] >= patience_[k]));
  }
  for (const std::size_t pixel : asleep_) stirred_[pixel] = 1;
  asleep_.clear();
  for (std::size_t k = 0; k < count; ++k) {
    if (stirred_[k] == 0) continue;
    if (changed && !filters) note_cause(k, before, after, next_level[k] - level_[k], 0);
    report(k, {from, to, noise_rate(k, intensity[k])}, level_[k], next_level[k], events);
    if (awake_[k] > to) asleep_.push_back(k);
  }
  if (changed || filters) level_.swap(next_level_);
}

// The level that the photoreceptor reaches: a first-order low pass of the log intensity, whose pace grows
// with the intensity; exact for an input that is linear in the interval.
void TileSensor::filter(const TileImage& before, const TileImage& after, float seconds) {
  const std::size_t count = tile_.area();
  const auto dark = static_cast<float>(options_.dark_intensity);
  const float* intensity = after.intensity.data();
  if (!(options_.cutoff > 0)) {
    for (std::size_t k = 0; k < count; ++k) next_level_[k] = fast_log(intensity[k] + dark);
    return;
  }
  for (std::size_t k = 0; k < count; ++k) next_log_[k] = fast_log(intensity[k] + dark);
  const auto pace =
      static_cast<float>(2 * std::numbers::pi * options_.cutoff / (1 + options_.dark_intensity));
  for (std::size_t k = 0; k < count; ++k) {
    const float x = seconds * pace * (intensity[k] + dark);
    const float change = next_log_[k] - log_[k], held_back = log_[k] - level_[k];
    const float settled = fast_saturation(x);
    // Of a ramp, the share that comes through within it: 1 - (1 - exp(-x)) / x, near x / 2 for small x.
    const float through = x > 0.05f ? 1 - settled / x : x * (0.5f - x / 6);
    next_level_[k] = level_[k] + held_back * settled + change * through;
  }
  for (std::size_t k = 0; k < count; ++k) {
    note_cause(k, before, after, next_log_[k] - log_[k], log_[k] - level_[k]);
  }
  log_.swap(next_log_);
}

// Keeps what changes a pixel, until something changes it more than half of what the low pass still holds
// back.
void TileSensor::note_cause(std::size_t pixel, const TileImage& before, const TileImage& after, float change,
                            float lag) {
  if (change == 0 || std::abs(change) <= 0.5f * std::abs(lag)) return;
  const bool shared = before.mixture[pixel] >= 0 || after.mixture[pixel] >= 0 ||
                      front_label(scene_, before, pixel) != front_label(scene_, after, pixel);
  cause_[pixel] =
      static_cast<std::int16_t>(shared ? responsible_label(scene_, before, after, pixel, change > 0 ? 1 : -1)
                                       : front_label(scene_, after, pixel));
}

// Events of one pixel in an interval in which its level runs linearly from start to end.
void TileSensor::report(std::size_t pixel, const Interval& interval, float start, float end,
                        std::vector<SimulatedEvent>& events) {
  const auto width = static_cast<std::size_t>(tile_.width);
  SimulatedEvent event;
  event.x = static_cast<std::uint16_t>(static_cast<std::size_t>(tile_.x0) + pixel % width);
  event.y = static_cast<std::uint16_t>(static_cast<std::size_t>(tile_.y0) + pixel / width);
  const double never = interval.to + 1, length = interval.to - interval.from;
  const double on = threshold_on_[pixel], off = threshold_off_[pixel], leak_rate = leak_[pixel];
  const double slope = (static_cast<double>(end) - start) / length;
  const auto level_at = [&](double t) { return start + slope * (t - interval.from); };
  double t = interval.from;
  double reported = reported_[pixel] + leak_rate * length;  // as it was at t

  // Noise comes when the exposure to it has used up the pixel's patience.
  double exposure = exposure_[pixel], patience = patience_[pixel];
  const auto next_noise = [&] {
    return exposure >= patience ? interval.to - (exposure - patience) / interval.noise_rate : never;
  };
  const auto begin_patience = [&] {
    exposure -= patience;
    patience = draw_patience(pixel);
  };

  while (true) {
    if (awake_[pixel] > t) {  // refractory: the pixel follows its level
      t = std::min(awake_[pixel], interval.to);
      reported = level_at(t);
      last_report_[pixel] = t;
      anchor_[pixel] = static_cast<float>(reported);
    }
    while (next_noise() < t) begin_patience();  // asleep when it came
    const double drift = slope + leak_rate;     // of the level against what was reported
    const double difference = level_at(t) - reported;
    double crossing = never;
    if (difference >= on || -difference >= off) {
      crossing = t;
      event.p = difference > 0 ? 1 : 0;
    } else if (drift != 0) {
      crossing = t + (drift > 0 ? on - difference : off + difference) / std::abs(drift);
      event.p = drift > 0 ? 1 : 0;
    }
    const double noise = next_noise();
    event.t = std::min(crossing, noise);
    if (!(event.t <= interval.to) || t >= interval.to) {
      reported -= leak_rate * (interval.to - t);
      break;
    }
    if (noise < crossing) {
      // Its polarity is a coin's; the pixel starts anew from the level it has.
      event.p = static_cast<std::uint8_t>(
          random_.bits(stream_of(pixel), Draw::events + 2 * std::uint64_t{draws_[pixel]} + 1) & 1);
      event.owner = -1;
      begin_patience();
      reported = level_at(event.t);
    } else {
      // A rise that is more the leak's work than the light's is noise.
      const double leaked = leak_rate * (event.t - last_report_[pixel]);
      const double risen = level_at(event.t) - anchor_[pixel];
      event.owner = event.p == 1 && leaked > risen ? std::int16_t{-1} : cause_[pixel];
      reported = reported - leak_rate * (event.t - t) + (event.p == 1 ? on : -off);
    }
    events.push_back(event);
    t = event.t;
    last_report_[pixel] = t;
    anchor_[pixel] = static_cast<float>(level_at(t));
    awake_[pixel] = t + options_.refractory;
  }
  reported_[pixel] = static_cast<float>(reported);
  exposure_[pixel] = static_cast<float>(exposure);
  patience_[pixel] = static_cast<float>(patience);
}

}  // namespace emseg::simulation
