// Wall-clock seconds of the stages of a segmentation.
#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace emseg {

using StageTimes = std::vector<std::pair<std::string, double>>;  // stage, seconds

class StageClock {
 public:
  explicit StageClock(StageTimes& times) : times_(times) {}

  // Adds the time since the last call, or since construction, to a stage.
  void lap(const std::string& stage) {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - last_).count();
    last_ = now;
    for (auto& [name, total] : times_) {
      if (name == stage) {
        total += seconds;
        return;
      }
    }
    times_.emplace_back(stage, seconds);
  }

 private:
  StageTimes& times_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace emseg
