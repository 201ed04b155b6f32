#include "tests/bench/roofs.hpp"

namespace dimple {
namespace {

constexpr int chains = 10;  // enough to hide the latency of two units of four or five cycles

template <class Number, int bytes>
struct Registers {
  typedef Number Type __attribute__((vector_size(bytes)));
};

// Compiled with contraction: fused in those functions below whose processors can.
template <class Real, int bytes>
[[gnu::always_inline]] inline double chains_of(std::int64_t rounds) {
  using Register = Registers<Real, bytes>::Type;
  Register x[chains], a = {}, b = {};
  a += Real(0.999);
  b += Real(1e-3);
#pragma GCC unroll 10
  for (int i = 0; i < chains; ++i) {
    x[i] = b * Real(i);
    asm volatile("" : "+x"(x[i]));  // keeps the compiler from computing the result beforehand
  }
  for (std::int64_t r = 0; r < rounds; ++r) {
#pragma GCC unroll 10
    for (int i = 0; i < chains; ++i) x[i] = x[i] * a + b;
  }
#pragma GCC unroll 10
  for (int i = 0; i < chains; ++i) asm volatile("" : : "x"(x[i]));
  return 2.0 * static_cast<double>(rounds) * chains * (bytes / sizeof(Real));
}

template <int bytes>
[[gnu::always_inline]] inline std::int64_t read_in(std::span<const std::int64_t> numbers) {
  using Register = Registers<std::int64_t, bytes>::Type;
  constexpr std::size_t width = bytes / sizeof(std::int64_t), together = 8;
  Register x[together] = {};
  for (std::size_t k = 0; k < numbers.size(); k += together * width) {
#pragma GCC unroll 8
    for (std::size_t i = 0; i < together; ++i)
      x[i] ^= *reinterpret_cast<const Register*>(numbers.data() + k + i * width);
  }
  Register all = {};
  for (std::size_t i = 0; i < together; ++i) all ^= x[i];
  std::int64_t result = 0;
  for (std::size_t i = 0; i < width; ++i) result ^= all[i];
  return result;
}

#if defined(__x86_64__)
// target_clones cannot be used: register widths differ, and with them the number of chains that fit.
#define DIMPLE_WIDTHS(Result, name, call, Argument)                     \
  __attribute__((target("avx512f,fma"))) Result name##_64(Argument n) { \
    return call(64);                                                    \
  }                                                                     \
  __attribute__((target("avx2,fma"))) Result name##_32(Argument n) {    \
    return call(32);                                                    \
  }                                                                     \
  Result name##_16(Argument n) {                                        \
    return call(16);                                                    \
  }
#define DIMPLE_READ(bytes) read_in<bytes>(n)
#define DIMPLE_SINGLE(bytes) chains_of<float, bytes>(n)
#define DIMPLE_DOUBLE(bytes) chains_of<double, bytes>(n)
DIMPLE_WIDTHS(std::int64_t, read, DIMPLE_READ, std::span<const std::int64_t>)
DIMPLE_WIDTHS(double, single, DIMPLE_SINGLE, std::int64_t)
DIMPLE_WIDTHS(double, twofold, DIMPLE_DOUBLE, std::int64_t)
__attribute__((target("avx2"))) double single_apart(std::int64_t n) {
  return chains_of<float, 32>(n);
}
__attribute__((target("avx2"))) double twofold_apart(std::int64_t n) {
  return chains_of<double, 32>(n);
}

int widest() {
  if (__builtin_cpu_supports("avx512f")) return 64;
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? 32 : 16;
}
#define DIMPLE_WIDEST(name, n) (widest() == 64 ? name##_64(n) : widest() == 32 ? name##_32(n) : name##_16(n))
#define DIMPLE_APART(name, n) (__builtin_cpu_supports("avx2") ? name##_apart(n) : name##_16(n))
#else
std::int64_t read_16(std::span<const std::int64_t> n) {
  return read_in<16>(n);
}
double single_16(std::int64_t n) {
  return chains_of<float, 16>(n);
}
double twofold_16(std::int64_t n) {
  return chains_of<double, 16>(n);
}
#define DIMPLE_WIDEST(name, n) name##_16(n)
#define DIMPLE_APART(name, n) name##_16(n)
#endif

}  // namespace

std::int64_t read_all(std::span<const std::int64_t> numbers) {
  return DIMPLE_WIDEST(read, numbers);
}
double multiply_add_single(std::int64_t rounds) {
  return DIMPLE_WIDEST(single, rounds);
}
double multiply_add_double(std::int64_t rounds) {
  return DIMPLE_WIDEST(twofold, rounds);
}
double multiply_then_add_single(std::int64_t rounds) {
  return DIMPLE_APART(single, rounds);
}
double multiply_then_add_double(std::int64_t rounds) {
  return DIMPLE_APART(twofold, rounds);
}

}  // namespace dimple
