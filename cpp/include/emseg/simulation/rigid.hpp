// Points, rotations, rigid poses, and how poses run through time.
#pragma once

#include <array>
#include <cmath>
#include <span>
#include <vector>

namespace emseg::simulation {

struct Vec3 {
  double x = 0, y = 0, z = 0;

  friend Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline double norm(Vec3 a) { return std::sqrt(dot(a, a)); }
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// A rotation and a translation: T_target_source maps a point of the source frame to the target frame.
struct Pose {
  std::array<Vec3, 3> rows{Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}};  // of the rotation matrix
  Vec3 translation;

  Vec3 rotate(Vec3 p) const { return {dot(rows[0], p), dot(rows[1], p), dot(rows[2], p)}; }
  Vec3 operator*(Vec3 p) const { return rotate(p) + translation; }
  friend bool operator==(const Pose&, const Pose&) = default;
};

Pose operator*(const Pose& T_a_b, const Pose& T_b_c);
Pose inverse(const Pose& T_a_b);

// A pose through time: cubic (Catmull-Rom) between equidistant samples of position and unit quaternion, held
// before the first and after the last.  What it interpolates is the truth: nothing else knows the motion.
class Path {
 public:
  struct Sample {
    Vec3 position;
    std::array<double, 4> quaternion{1, 0, 0, 0};  // w, x, y, z
  };

  Path() : samples_(1) {}

  // The first sample is at time 0; `interval` in seconds.  Quaternions are normalised, and of each the sign
  // is taken that is nearer to the one before. Throws std::invalid_argument for no samples, an interval that
  // is not positive, or numbers that are not finite or, of a quaternion, all zero.
  Path(std::vector<Sample> samples, double interval);

  Pose at(double seconds) const;
  bool is_still() const { return samples_.size() == 1; }

 private:
  std::vector<Sample> samples_;
  double interval_ = 1;
};

}  // namespace emseg::simulation
