// 64-bit sums that refuse to overflow: the one place where energies and capacities are checked.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

namespace emseg {

// Adds non-negative terms; a total beyond 2^62 throws, so that a sum and a difference of two totals still
// fit.
class CheckedSum {
 public:
  explicit CheckedSum(const char* name) : name_(name) {}

  void add(std::int64_t term) {
    if (__builtin_add_overflow(total_, term, &total_) || total_ > kLimit) fail();
  }
  void add_product(std::int64_t factor, std::int64_t term) {
    std::int64_t product = 0;
    if (__builtin_mul_overflow(factor, term, &product)) fail();
    add(product);
  }
  std::int64_t total() const { return total_; }

 private:
  static constexpr std::int64_t kLimit = std::int64_t{1} << 62;

  [[noreturn]] void fail() const {
    throw std::invalid_argument(std::string(name_) + " is larger than 2^62, expected sums that fit 64 bits");
  }

  const char* name_;
  std::int64_t total_ = 0;
};

}  // namespace emseg
