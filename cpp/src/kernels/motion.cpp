// Warps of many points and the gradient by their coefficients; and the functions that they are made of.
#include "kernels/kernels.hpp"
#include "kernels/vector.hpp"

namespace emseg::EMSEG_SIMD_LEVEL {
namespace {

// Sine of angles up to a few thousand radians, to 2e-7.  T is float or a vector of floats.
template <typename T>
inline T sine(T angle) {
  // The nearest multiple of pi: the sum's last bit is worth 1, and even multiples leave it at 0.
  constexpr float round_to_whole = 12582912.0f;  // 1.5 2^23
  const T shifted = angle * 0.318309886f + round_to_whole;
  const T turns = shifted - round_to_whole;
  const T half = 0.5f * turns + round_to_whole;
  const T odd = turns - 2 * (half - round_to_whole);  // -1, 0 or 1
  // pi in two parts, the first of few enough bits for its product with `turns` to be exact.
  const T r = (angle - turns * 3.140625f) - turns * 9.67653590e-4f;
  const T s = r * r;
  const T series =
      s * (-1.0f / 6 + s * (1.0f / 120 + s * (-1.0f / 5040 + s * (1.0f / 362880 + s * (-1.0f / 39916800)))));
  return (r + r * series) * (1 - 2 * odd * odd);
}

// f' - f of a bearing f = (bx, by, 1) turned about the axis a, by Rodrigues; 1 - cos is taken from the half
// angle to keep its digits.
template <typename T>
struct Turn {
  T x, y, z;

  Turn(const WarpField& field, T bx, T by, T dt) {
    const T angle = -field.speed * dt;
    const T sin = sine(angle);
    const T half = sine(0.5f * angle);
    const T versine = 2 * half * half;
    const T along = field.ax * bx + field.ay * by + field.az;
    x = sin * (field.ay - field.az * by) + versine * (field.ax * along - bx);
    y = sin * (field.az * bx - field.ax) + versine * (field.ay * along - by);
    z = sin * (field.ax * by - field.ay * bx) + versine * (field.az * along - 1);
  }
};

void warp_rotation(const WarpField& field, const float* x, const float* y, const float* dt, std::size_t n,
                   float* warped_x, float* warped_y) {
  const WarpField f = field;
  for (std::size_t k = 0; k < n; ++k) {
    const Turn<float> turn(f, (x[k] - f.px) / f.fx, (y[k] - f.py) / f.fy, dt[k]);
    const float depth = 1 + turn.z;
    // x' - x, not x': small numbers keep their digits.
    const float moved_x = x[k] + (f.fx * turn.x - (x[k] - f.px) * turn.z) / depth;
    const float moved_y = y[k] + (f.fy * turn.y - (y[k] - f.py) * turn.z) / depth;
    warped_x[k] = depth > 0 ? moved_x : __builtin_inff();
    warped_y[k] = depth > 0 ? moved_y : __builtin_inff();
  }
}

}  // namespace

void warp(const WarpField& field, const float* x, const float* y, const float* dt, std::size_t n,
          float* warped_x, float* warped_y) {
  const WarpField f = field;
  switch (f.form) {
    case WarpField::Form::translation:
      for (std::size_t k = 0; k < n; ++k) {
        warped_x[k] = x[k] - dt[k] * f.vx;
        warped_y[k] = y[k] - dt[k] * f.vy;
      }
      return;
    case WarpField::Form::linear:
      for (std::size_t k = 0; k < n; ++k) {
        const float rx = x[k] - f.cx, ry = y[k] - f.cy;
        warped_x[k] = x[k] - dt[k] * (f.vx + f.b11 * rx + f.b12 * ry);
        warped_y[k] = y[k] - dt[k] * (f.vy + f.b21 * rx + f.b22 * ry);
      }
      return;
    case WarpField::Form::projective:
      for (std::size_t k = 0; k < n; ++k) {
        const float rx = x[k] - f.cx, ry = y[k] - f.cy;
        const float bend = f.g * rx + f.h * ry;
        warped_x[k] = x[k] - dt[k] * (f.vx + f.b11 * rx + f.b12 * ry + rx * bend);
        warped_y[k] = y[k] - dt[k] * (f.vy + f.b21 * rx + f.b22 * ry + ry * bend);
      }
      return;
    case WarpField::Form::rotation:
      return warp_rotation(f, x, y, dt, n, warped_x, warped_y);
  }
}

namespace {

void add_rotation_gradient(const WarpField& field, const float* const (&streams)[5], std::size_t n,
                           double* sum) {
  BlockSum parts[3];
  for_each_vector(streams, n, [&](const float* const* at, std::size_t i) {
    const Floats x = load(at[0] + i), y = load(at[1] + i), dt = load(at[2] + i);
    const Floats bx = (x - field.px) / field.fx, by = (y - field.py) / field.fy;
    const Turn<Floats> turn(field, bx, by, dt);
    const Floats fx = bx + turn.x, fy = by + turn.y, fz = 1 + turn.z;
    // The slope by f', of x' = K f' / f'_z; none where the point turns behind the camera.
    const Floats depth = fz > 0 ? 1 / fz : Floats{};
    const Floats qx = field.fx * load(at[3] + i) * depth, qy = field.fy * load(at[4] + i) * depth;
    const Floats qz = -(fx * qx + fy * qy) * depth;
    // d exp([phi]x) b = -[f']x J(phi) dphi with phi = -dt w and the left Jacobian J = sinc I + (1 - sinc) a
    // a^T
    // + cosc [a]x, hence the slope by w is J^T m with m = dt (q x f').
    const Floats mx = dt * (qy * fz - qz * fy), my = dt * (qz * fx - qx * fz), mz = dt * (qx * fy - qy * fx);
    const Floats angle = -field.speed * dt;
    const Floats half = sine(0.5f * angle);
    const auto turns = (angle > 1e-4f) | (angle < -1e-4f);
    const Floats divisor = turns ? angle : Floats{} + 1;
    const Floats sinc = turns ? sine(angle) / divisor : Floats{} + 1;
    const Floats cosc = turns ? 2 * half * half / divisor : 0.5f * angle;
    const Floats along = (1 - sinc) * (field.ax * mx + field.ay * my + field.az * mz);
    parts[0].add(i, sinc * mx + along * field.ax + cosc * (my * field.az - mz * field.ay));
    parts[1].add(i, sinc * my + along * field.ay + cosc * (mz * field.ax - mx * field.az));
    parts[2].add(i, sinc * mz + along * field.az + cosc * (mx * field.ay - my * field.ax));
  });
  for (std::size_t d = 0; d < 3; ++d) sum[d] += parts[d].total();
}

template <WarpField::Form Form>
void add_field_gradient(const WarpField& field, const float* const (&streams)[5], std::size_t n,
                        double* sum) {
  constexpr bool linear = Form != WarpField::Form::translation;
  constexpr bool projective = Form == WarpField::Form::projective;
  constexpr std::size_t count = projective ? 8 : linear ? 6 : 2;
  BlockSum parts[count];
  for_each_vector(streams, n, [&](const float* const* at, std::size_t i) {
    const Floats dt = load(at[2] + i);
    const Floats sx = dt * load(at[3] + i), sy = dt * load(at[4] + i);
    parts[0].add(i, sx);
    parts[1].add(i, sy);
    if constexpr (linear) {
      const Floats rx = load(at[0] + i) - field.cx, ry = load(at[1] + i) - field.cy;
      const Floats xx = rx * sx, yy = ry * sy;
      parts[2].add(i, xx);
      parts[3].add(i, ry * sx);
      parts[4].add(i, rx * sy);
      parts[5].add(i, yy);
      if constexpr (projective) {
        parts[6].add(i, rx * (xx + yy));
        parts[7].add(i, ry * (xx + yy));
      }
    }
  });
  for (std::size_t d = 0; d < count; ++d) sum[d] -= parts[d].total();
}

}  // namespace

void add_gradient(const WarpField& field, const float* x, const float* y, const float* dt,
                  const float* slope_x, const float* slope_y, std::size_t n, double* sum) {
  const float* const streams[5] = {x, y, dt, slope_x, slope_y};
  switch (field.form) {
    case WarpField::Form::translation:
      return add_field_gradient<WarpField::Form::translation>(field, streams, n, sum);
    case WarpField::Form::linear:
      return add_field_gradient<WarpField::Form::linear>(field, streams, n, sum);
    case WarpField::Form::projective:
      return add_field_gradient<WarpField::Form::projective>(field, streams, n, sum);
    case WarpField::Form::rotation:
      return add_rotation_gradient(field, streams, n, sum);
  }
}

void natural_log(const float* values, std::size_t n, float* logs) {
  for (std::size_t k = 0; k < n; ++k) {
    // values = m 2^e with m in [sqrt(1/2), sqrt(2)): the bits of sqrt(1/2) move the seam of the exponent.
    const auto bits = __builtin_bit_cast(std::int32_t, values[k]);
    const std::int32_t exponent = (bits - 0x3f3504f3) >> 23;
    const auto m = __builtin_bit_cast(float, bits - (exponent << 23));
    // log m = 2 artanh s, s = (m - 1) / (m + 1); the next term of the series is below 1e-9.
    const float s = (m - 1) / (m + 1);
    const float q = s * s;
    const float series = 2 * s + 2 * s * (q * (1.0f / 3 + q * (1.0f / 5 + q * (1.0f / 7 + q * (1.0f / 9)))));
    // log 2 in two parts, the first of which times an exponent is exact.
    const auto e = static_cast<float>(exponent);
    logs[k] = e * 0.693359375f + (series + e * -2.12194440e-4f);
  }
}

}  // namespace emseg::EMSEG_SIMD_LEVEL
