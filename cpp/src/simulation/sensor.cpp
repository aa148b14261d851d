#include "emseg/simulation/sensor.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <stdexcept>
#include <string>

#include "emseg/simulation/numeric.hpp"

namespace emseg::simulation {
namespace {

// Draws of a pixel: the first ones are spoken for.
enum Draw : std::uint64_t { on_threshold = 0, off_threshold = 3, phase = 6, hot = 7, hot_share = 8, leak = 9, events = 12 };

void check(const char* name, double value, bool sound, const char* expected) {
  if (!sound) {
    throw std::invalid_argument("sensor: " + std::string(name) + " is " + std::to_string(value) + ", expected " +
                                expected);
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

// The intensity of a pixel is, from front to back, I_k = a_k c_k + (1 - a_k) I_{k+1}, with colours c and shares a
// of what the surfaces in front leave.  To first order its change is a sum over surfaces of
// r_k (da_k (c_k - I_{k+1}) + a_k dc_k), r_k what is left of the pixel in front of k: the change that surface k
// makes alone.
int responsible_label(const Scene& scene, const TileImage& before, const TileImage& after, std::size_t pixel,
                      int direction) {
  Parts parts;
  parts.add(0, before, pixel);
  parts.add(1, after, pixel);
  if (parts.count == 1) return label_of(scene, parts.items[0].surface);
  std::stable_sort(parts.items.begin(), parts.items.begin() + static_cast<std::ptrdiff_t>(parts.count),
                   [](const Part& a, const Part& b) { return a.inverse_depth > b.inverse_depth; });
  // Intensity of what lies behind each part, before and after; behind the last there is nothing.
  std::array<std::array<float, 2>, most_parts + 1> behind{};
  for (std::size_t side = 0; side < 2; ++side) {
    float weight = 0, sum = 0;
    for (std::size_t k = parts.count; k-- > 0;) {
      behind[k][side] = weight > 1e-6f ? sum / weight : parts.items[k].intensity[side];
      weight += parts.items[k].weight[side];
      sum += parts.items[k].weight[side] * parts.items[k].intensity[side];
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

// What does not depend on the pixel while two pictures follow each other.
struct TileSensor::Interval {
  double from, to;
};

TileSensor::TileSensor(const Scene& scene, const SensorOptions& options, Region tile, const TileImage& first)
    : scene_(scene), options_(options), random_(options.seed), tile_(tile) {
  const std::size_t count = tile.area();
  assert(first.intensity.size() == count);
  const auto dark = static_cast<float>(options.dark_intensity);
  const double least_threshold = 0.1 * std::min(options.threshold_on, options.threshold_off);
  for (std::size_t k = 0; k < count; ++k) {
    const auto width = static_cast<std::size_t>(tile.width);
    const std::uint64_t stream = ((static_cast<std::uint64_t>(tile.y0) + k / width) << 32) +
                                 static_cast<std::uint64_t>(tile.x0) + k % width;
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
    hot_rate_.push_back(is_hot ? static_cast<float>(options.hot_rate * 2 * random_.uniform(stream, Draw::hot_share))
                               : 0.0f);
    log_.push_back(static_cast<float>(log_intensity));
    // Each pixel starts somewhere between two reports; from the same place all would fire together.
    const double share = 0.98 * random_.uniform(stream, Draw::phase) + 0.01;
    reported_.push_back(static_cast<float>(log_intensity - on + share * (on + off)));
    cause_.push_back(static_cast<std::int16_t>(front_label(scene, first, k)));
  }
  level_ = log_;
  exposure_.assign(count, 0.0f);
  deadline_.resize(count);
  awake_.assign(count, first.seconds);
  last_report_.assign(count, first.seconds);
  draws_.assign(count, 0);
  next_level_.resize(count);
  stirred_.resize(count);
  for (std::size_t k = 0; k < count; ++k) draw_noise_deadline(k);
}

void TileSensor::draw_noise_deadline(std::size_t pixel) {
  const auto width = static_cast<std::size_t>(tile_.width);
  const std::uint64_t stream = ((static_cast<std::uint64_t>(tile_.y0) + pixel / width) << 32) +
                               static_cast<std::uint64_t>(tile_.x0) + pixel % width;
  exposure_[pixel] = 0;
  deadline_[pixel] = static_cast<float>(random_.exponential(stream, Draw::events + 2 * draws_[pixel]));
}

void TileSensor::expose(const TileImage& before, const TileImage& after, double from, double to,
                        std::vector<SimulatedEvent>& events) {
  const std::size_t count = tile_.area();
  const auto seconds = static_cast<float>(to - from);
  const auto dark = static_cast<float>(options_.dark_intensity);
  const auto noise = static_cast<float>(options_.shot_noise);
  const auto fading = static_cast<float>(options_.shot_noise * (1 - options_.shot_noise_bright));
  const auto pace = static_cast<float>(2 * 3.14159265358979 * options_.cutoff / (1 + options_.dark_intensity));
  const float* intensity = after.intensity.data();
  if (&before != &after || options_.cutoff > 0) {
    for (std::size_t k = 0; k < count; ++k) {
      const float next = fast_log(intensity[k] + dark);
      if (options_.cutoff > 0) {
        // First-order low pass, exact for an input that is linear in the interval.
        const float x = seconds * pace * (intensity[k] + dark);
        const float change = next - log_[k];
        const float lag = change / std::max(x, 1e-9f);
        const float settled = fast_saturation(x);
        next_level_[k] = x > 1e-3f ? level_[k] + change - lag * settled + (log_[k] - level_[k]) * settled
                                   : level_[k] + x * (0.5f * (next + log_[k]) - level_[k]);
        note_cause(k, before, after, change, log_[k] - level_[k]);
        log_[k] = next;
      } else {
        next_level_[k] = next;
      }
    }
  }
  const bool still = &before == &after && !(options_.cutoff > 0);
  const float* next_level = still ? level_.data() : next_level_.data();
  for (std::size_t k = 0; k < count; ++k) {
    reported_[k] -= leak_[k] * seconds;
    exposure_[k] += seconds * (hot_rate_[k] + std::max(noise - fading * intensity[k], 0.0f));
    const float difference = next_level[k] - reported_[k];
    stirred_[k] = static_cast<std::uint8_t>((difference >= threshold_on_[k]) | (-difference >= threshold_off_[k]) |
                                            (exposure_[k] >= deadline_[k]) | (awake_[k] > from));
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (stirred_[k] == 0) continue;
    if (!(options_.cutoff > 0) && &before != &after) {
      note_cause(k, before, after, next_level[k] - level_[k], 0);
    }
    report(k, {from, to}, level_[k], next_level[k], events);
  }
  if (!still) level_.swap(next_level_);
}

// Keeps what changes a pixel, until something changes it more than half of what the low pass still holds back.
void TileSensor::note_cause(std::size_t pixel, const TileImage& before, const TileImage& after, float change,
                            float lag) {
  if (change == 0 || std::abs(change) <= 0.5f * std::abs(lag)) return;
  const bool shared = before.mixture[pixel] >= 0 || after.mixture[pixel] >= 0 ||
                      front_label(scene_, before, pixel) != front_label(scene_, after, pixel);
  cause_[pixel] = static_cast<std::int16_t>(
      shared ? responsible_label(scene_, before, after, pixel, change > 0 ? 1 : -1)
             : front_label(scene_, after, pixel));
}

// Events of one pixel in an interval in which its level runs linearly from start to end.
void TileSensor::report(std::size_t pixel, const Interval& interval, float start, float end,
                        std::vector<SimulatedEvent>& events) {
  const auto width = static_cast<std::size_t>(tile_.width);
  SimulatedEvent event;
  event.x = static_cast<std::uint16_t>(static_cast<std::size_t>(tile_.x0) + pixel % width);
  event.y = static_cast<std::uint16_t>(static_cast<std::size_t>(tile_.y0) + pixel / width);
  const double length = interval.to - interval.from;
  const double leak_rate = leak_[pixel];
  const double slope = (static_cast<double>(end) - start) / length;
  const auto level_at = [&](double t) { return start + slope * (t - interval.from); };
  double t = interval.from;
  double reported = reported_[pixel] + leak_rate * length;  // as it was at t
  // The noise event of this interval, if any, comes where its exposure reaches the deadline.
  const bool noisy = exposure_[pixel] >= deadline_[pixel];
  double noise_at = interval.to + 1;
  if (noisy) {
    const CounterRandom& random = random_;
    const std::uint64_t stream = (static_cast<std::uint64_t>(event.y) << 32) + event.x;
    noise_at = interval.from + length * random.uniform(stream, Draw::events + 2 * draws_[pixel] + 1);
  }
  while (true) {
    if (awake_[pixel] > t) {  // refractory: the pixel follows its level
      if (awake_[pixel] >= interval.to) {
        reported = end;
        t = interval.to;
        last_report_[pixel] = t;
        break;
      }
      t = awake_[pixel];
      reported = level_at(t);
      last_report_[pixel] = t;
    }
    if (noise_at < t) noise_at = interval.to + 1;  // asleep when it came
    const double drift = slope + leak_rate;  // of the level against what was reported
    const double difference = level_at(t) - reported;
    double crossing = interval.to + 1;
    if (difference >= threshold_on_[pixel] || -difference >= threshold_off_[pixel]) {
      crossing = t;
    } else if (drift > 0) {
      crossing = t + (threshold_on_[pixel] - difference) / drift;
    } else if (drift < 0) {
      crossing = t + (threshold_off_[pixel] + difference) / -drift;
    }
    const double next = std::min(crossing, noise_at);
    if (!(next <= interval.to)) {
      reported -= leak_rate * (interval.to - t);
      break;
    }
    const bool is_noise = noise_at < crossing;
    if (!is_noise && difference < threshold_on_[pixel] && -difference < threshold_off_[pixel]) {
      event.p = drift > 0 ? 1 : 0;
    } else {
      event.p = difference > 0 ? 1 : 0;
    }
    event.t = next;
    event.owner = cause_[pixel];
    if (is_noise) {
      // Its polarity is a coin's; the pixel starts anew from the level it has.
      const std::uint64_t stream = (static_cast<std::uint64_t>(event.y) << 32) + event.x;
      event.p = static_cast<std::uint8_t>(random_.bits(stream, Draw::events + 2 * draws_[pixel] + 1) & 1);
      event.owner = -1;
      noise_at = interval.to + 1;
      reported = level_at(next);
    } else {
      // A rise that is more the leak's work than the light's is noise.
      const double leaked = leak_rate * (next - last_report_[pixel]);
      if (event.p == 1 && leaked > 0.5 * threshold_on_[pixel]) event.owner = -1;
      const double step = event.p == 1 ? threshold_on_[pixel] : -static_cast<double>(threshold_off_[pixel]);
      reported = reported - leak_rate * (next - t) + step;
      if (options_.refractory > 0) reported = level_at(next);
    }
    events.push_back(event);
    t = next;
    last_report_[pixel] = next;
    awake_[pixel] = next + options_.refractory;
  }
  reported_[pixel] = static_cast<float>(reported);
  if (noisy) {
    ++draws_[pixel];
    draw_noise_deadline(pixel);
  }
}

}  // namespace emseg::simulation
