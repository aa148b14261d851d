#include "emseg/simulation/rigid.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace emseg::simulation {
namespace {

Pose pose_of(Vec3 position, std::array<double, 4> q) {
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const auto [w, x, y, z] = std::array{q[0] / length, q[1] / length, q[2] / length, q[3] / length};
  Pose pose;
  pose.rows = {Vec3{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
               Vec3{2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
               Vec3{2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
  pose.translation = position;
  return pose;
}

bool is_finite(const Path::Sample& sample) {
  bool finite = std::isfinite(sample.position.x) && std::isfinite(sample.position.y) &&
                std::isfinite(sample.position.z);
  for (const double part : sample.quaternion) finite = finite && std::isfinite(part);
  return finite;
}

}  // namespace

Pose operator*(const Pose& T_a_b, const Pose& T_b_c) {
  Pose T_a_c;
  for (std::size_t i = 0; i < 3; ++i) {
    const Vec3 row = T_a_b.rows[i];
    T_a_c.rows[i] = row.x * T_b_c.rows[0] + row.y * T_b_c.rows[1] + row.z * T_b_c.rows[2];
  }
  T_a_c.translation = T_a_b * T_b_c.translation;
  return T_a_c;
}

Pose inverse(const Pose& T_a_b) {
  const auto& r = T_a_b.rows;
  Pose T_b_a;
  T_b_a.rows = {Vec3{r[0].x, r[1].x, r[2].x}, Vec3{r[0].y, r[1].y, r[2].y}, Vec3{r[0].z, r[1].z, r[2].z}};
  T_b_a.translation = -1.0 * T_b_a.rotate(T_a_b.translation);
  return T_b_a;
}

Path::Path(std::vector<Sample> samples, double interval) : samples_(std::move(samples)), interval_(interval) {
  if (samples_.empty()) throw std::invalid_argument("path: no samples, expected at least one");
  if (!(interval > 0) || !std::isfinite(interval)) {
    throw std::invalid_argument("path: interval is " + std::to_string(interval) +
                                " s, expected a positive number");
  }
  for (std::size_t k = 0; k < samples_.size(); ++k) {
    auto& q = samples_[k].quaternion;
    const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!is_finite(samples_[k]) || !(length > 0)) {
      throw std::invalid_argument("path: sample " + std::to_string(k) +
                                  " is no pose, expected finite numbers and a quaternion that is not zero");
    }
    double along = 1;
    if (k > 0) {
      const auto& before = samples_[k - 1].quaternion;
      along = q[0] * before[0] + q[1] * before[1] + q[2] * before[2] + q[3] * before[3];
    }
    for (double& part : q) part /= along < 0 ? -length : length;
  }
}

Pose Path::at(double seconds) const {
  const auto last = static_cast<std::ptrdiff_t>(samples_.size()) - 1;
  const double place = std::clamp(seconds / interval_, 0.0, static_cast<double>(last));
  const auto k = std::min(static_cast<std::ptrdiff_t>(place), std::max<std::ptrdiff_t>(last - 1, 0));
  const double s = place - static_cast<double>(k);
  const Sample& here = samples_[static_cast<std::size_t>(k)];
  if (s == 0) return pose_of(here.position, here.quaternion);
  const double s2 = s * s, s3 = s2 * s;
  const std::array<double, 4> weight{(-s3 + 2 * s2 - s) / 2, (3 * s3 - 5 * s2 + 2) / 2,
                                     (-3 * s3 + 4 * s2 + s) / 2, (s3 - s2) / 2};
  Vec3 position;
  std::array<double, 4> quaternion{};
  const auto add = [&](std::ptrdiff_t index, double w) {
    const Sample& sample = samples_[static_cast<std::size_t>(index)];
    position = position + w * sample.position;
    for (std::size_t i = 0; i < 4; ++i) quaternion[i] += w * sample.quaternion[i];
  };
  for (std::ptrdiff_t j = 0; j < 4; ++j) {
    const double w = weight[static_cast<std::size_t>(j)];
    const std::ptrdiff_t index = k - 1 + j;
    const std::ptrdiff_t inwards = index < 0 ? 1 : -1;
    if (index >= 0 && index <= last) {
      add(index, w);
    } else if (last >= 2) {  // beyond an end the parabola through its three samples goes on
      const std::ptrdiff_t end = index + inwards;
      add(end, 3 * w), add(end + inwards, -3 * w), add(end + 2 * inwards, w);
    } else {  // or the line through the two there are
      add(index + inwards, 2 * w), add(index + 2 * inwards, -w);
    }
  }
  return pose_of(position, quaternion);
}

}  // namespace emseg::simulation
