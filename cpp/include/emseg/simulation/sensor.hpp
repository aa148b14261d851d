// The sensor: pixels that report when the logarithm of their intensity has changed by a threshold.
//
// After Lichtsteiner, Posch, Delbruck, "A 128x128 120 dB 15 us latency asynchronous temporal contrast vision
// sensor", JSSC 2008; noise after Hu, Liu, Delbruck, "v2e: from video frames to realistic DVS events", CVPRW
// 2021; crossings between two moments by linear interpolation, as in Rebecq, Gehrig, Scaramuzza, "ESIM: an
// open event camera simulator", CoRL 2018.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "emseg/image.hpp"
#include "emseg/simulation/random.hpp"
#include "emseg/simulation/raster.hpp"

namespace emseg::simulation {

struct SensorOptions {
  double threshold_on = 0.25;     // rise in log intensity that is reported
  double threshold_off = 0.25;    // fall
  double threshold_sigma = 0.03;  // standard deviation of both between pixels, in log intensity
  double refractory = 1e-3;       // s, after an event, during which a pixel follows without reporting
  double cutoff = 0;              // Hz, of the photoreceptor's low pass at intensity 1; 0: none
  double dark_intensity = 0.02;  // added to the intensity: dark current; also what is left of the cutoff at 0
  double shot_noise = 0;         // Hz, noise events of a pixel in the dark
  double shot_noise_bright = 0.25;  // share of it that is left at intensity 1, linear between
  double leak = 0;                  // Hz, rises that a pixel reports by itself
  double leak_sigma = 0.2;          // standard deviation of it between pixels, as a share
  double hot_fraction = 0;          // share of pixels that fire by themselves
  double hot_rate = 50;             // Hz, their mean rate
  std::uint64_t seed = 0;
};

// Throws std::invalid_argument that names the option, its value and what was expected.
void check_sensor(const SensorOptions& options);

struct SimulatedEvent {
  double t = 0;  // s
  std::uint16_t x = 0, y = 0;
  std::uint8_t p = 0;
  std::int16_t owner = 0;  // label of the surface whose motion or light made it; -1: noise
};

// The surface whose change made a pixel brighter (direction 1) or darker (-1) between two pictures: of all
// surfaces in the pixel the one that, changing alone, would move the intensity most in that direction.
// Returns its label.
int responsible_label(const Scene& scene, const TileImage& before, const TileImage& after, std::size_t pixel,
                      int direction);

// The pixels of a tile.
class TileSensor {
 public:
  TileSensor(const Scene& scene, const SensorOptions& options, Region tile, const TileImage& first);

  // The time from one picture to the next, between which log intensity is linear; appends what is reported.
  void expose(const TileImage& before, const TileImage& after, double from, double to,
              std::vector<SimulatedEvent>& events);

 private:
  struct Interval {
    double from = 0, to = 0;
    float noise_rate = 0;  // Hz
  };

  float noise_rate(std::size_t pixel, float intensity) const {
    const float shot = shot_noise_dark_ - shot_noise_fading_ * intensity;
    return hot_rate_[pixel] + (shot > 0 ? shot : 0.0f);
  }
  void filter(const TileImage& before, const TileImage& after, float seconds);
  void report(std::size_t pixel, const Interval& interval, float start, float end,
              std::vector<SimulatedEvent>& events);
  void note_cause(std::size_t pixel, const TileImage& before, const TileImage& after, float change,
                  float lag);
  std::uint64_t stream_of(std::size_t pixel) const;
  double draw_patience(std::size_t pixel);

  const Scene& scene_;
  SensorOptions options_;
  CounterRandom random_;
  Region tile_;
  float shot_noise_dark_, shot_noise_fading_;  // Hz, at intensity 0, and less at 1
  std::vector<float> log_;                     // log intensity at the photoreceptor
  std::vector<float> level_;                   // the same behind the low pass
  std::vector<float> reported_;                // level at the last report, lowered by the leak since
  std::vector<float> threshold_on_, threshold_off_;
  std::vector<float> leak_;          // 1/s, in log intensity
  std::vector<float> hot_rate_;      // Hz
  std::vector<float> exposure_;      // to noise since its last event: its rate summed over time
  std::vector<float> patience_;      // exposure at which the next noise event comes
  std::vector<double> awake_;        // s, end of the refractory time
  std::vector<double> last_report_;  // s
  std::vector<float> anchor_;        // level at the last report, or at the beginning
  std::vector<std::uint32_t> draws_;
  std::vector<std::int16_t> cause_;  // label of what last changed the pixel
  std::vector<std::size_t> asleep_;  // pixels that may be in their refractory time
  std::vector<float> next_log_, next_level_;
  std::vector<std::uint8_t> stirred_;
};

}  // namespace emseg::simulation
