#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

// Vector operations of the force kernel. Arithmetic is that of GCC's vector types, whose + - * < and ?: act
// on each lane separately; no sum is reordered, and -ffp-contract=off keeps products and sums apart. So
// registers of any width and processors of any age round alike.
//
// A register holds either one number of each of 4 or 8 points, or the four numbers (x, y, z, padding) of each
// of 1, 2 or 4 nodes, end to end.

// Macros, because off x86-64 the attributes must not be there at all.
#if defined(__x86_64__)
#define DIMPLE_AVX2 __attribute__((target("avx2")))
#define DIMPLE_AVX512 __attribute__((target("avx512f")))
#else
#define DIMPLE_AVX2
#define DIMPLE_AVX512
#endif

// GCC warns where registers are returned, here and in the file that includes this. But all is inlined into
// the clone for a processor: no register meets a calling convention.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace dimple::wide {

/// True if the processor runs functions with 32-byte or 64-byte registers. Clang refuses the 64-byte assembly
/// unless it is inlined.
#if defined(__x86_64__)
inline const bool has_avx2 = __builtin_cpu_supports("avx2");
#else
inline constexpr bool has_avx2 = false;
#endif
#if defined(__x86_64__) && !defined(__clang__)
#define DIMPLE_ASSEMBLY
inline const bool has_avx512 = __builtin_cpu_supports("avx512f");
#else
inline constexpr bool has_avx512 = false;
#endif

template <class Real, int count>
struct Registers {  // typedef, since `using` drops the attributes of types that depend on Real
  typedef Real Pack __attribute__((vector_size(count * sizeof(Real))));
  typedef Real Loose __attribute__((vector_size(count * sizeof(Real)), aligned(sizeof(Real)), may_alias));
  typedef Real Aligned
      __attribute__((vector_size(count * sizeof(Real)), aligned(sizeof(Real) == 4 ? 16 : 8), may_alias));
};
/// A register of `count` numbers.
template <class Real, int count>
using Pack = typename Registers<Real, count>::Pack;
/// A register of four numbers of each of `nodes` nodes.
template <class Real, int nodes>
using Nodes = Pack<Real, 4 * nodes>;
/// A node's or a column's four numbers in memory: floats at multiples of 16 bytes, doubles anywhere.
template <class Real>
using Four = typename Registers<Real, 4>::Aligned;

/// `count` numbers from any address; and to any.
template <int count, class Real>
[[gnu::always_inline]] inline Pack<Real, count> load(const Real* from) {
  return *reinterpret_cast<const typename Registers<Real, count>::Loose*>(from);
}
template <int count, class Real>
[[gnu::always_inline]] inline void store(Real* to, const Pack<Real, count>& numbers) {
  *reinterpret_cast<typename Registers<Real, count>::Loose*>(to) = numbers;
}

/// The four numbers of node or column `n`, to read or to change.
template <class Real>
[[gnu::always_inline]] inline const Four<Real>& four(const Real* values, std::ptrdiff_t n = 0) {
  return reinterpret_cast<const Four<Real>*>(values)[n];
}
template <class Real>
[[gnu::always_inline]] inline Four<Real>& four(Real* values, std::ptrdiff_t n = 0) {
  return reinterpret_cast<Four<Real>*>(values)[n];
}

/// Lanes 4 n to 4 n + 3: what a register has of node n.
template <int n, class Register>
[[gnu::always_inline]] inline auto part(const Register& a) {
  return __builtin_shufflevector(a, a, 4 * n, 4 * n + 1, 4 * n + 2, 4 * n + 3);
}

/// Half registers end to end.
template <class Real>
[[gnu::always_inline]] inline Pack<Real, 8> join(const Pack<Real, 4>& a, const Pack<Real, 4>& b) {
  return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
}

/// `nodes` copies of four numbers in one register.
template <int nodes, class Real>
[[gnu::always_inline]] inline Nodes<Real, nodes> repeat(const Real* from) {
  const Pack<Real, 4> a = four(from);
  if constexpr (nodes == 1) return a;
  if constexpr (nodes == 2) return join<Real>(a, a);
  if constexpr (nodes == 4) {
    const auto two = join<Real>(a, a);
    return __builtin_shufflevector(two, two, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7);
  }
}

/// The sum over nodes; of four, (0 + 2) + (1 + 3).
template <class Real, int nodes>
[[gnu::always_inline]] inline Pack<Real, 4> sum_of_nodes(const Nodes<Real, nodes>& a) {
  if constexpr (nodes == 1) return a;
  if constexpr (nodes == 2) return part<0>(a) + part<1>(a);
  if constexpr (nodes == 4)
    return sum_of_nodes<Real, 2>(__builtin_shufflevector(a, a, 0, 1, 2, 3, 4, 5, 6, 7) +
                                 __builtin_shufflevector(a, a, 8, 9, 10, 11, 12, 13, 14, 15));
}

/// The numbers of `nodes` nodes in `values`; `twice`: twice their numbers. Four nodes need AVX-512.
template <int nodes, class Real>
[[gnu::always_inline]] inline Nodes<Real, nodes> gather(const Real* values, const std::uint16_t* twice) {
  if constexpr (nodes == 1) return four(values + 2 * twice[0]);
  if constexpr (nodes == 2) return join<Real>(four(values + 2 * twice[0]), four(values + 2 * twice[1]));
  if constexpr (nodes == 4) {
    std::uint64_t all;  // the four numbers with one load
    std::memcpy(&all, twice, sizeof all);
    const Four<Real>&a = four(values + 2 * (all & 0xffff)), &b = four(values + 2 * (all >> 16 & 0xffff)),
          &c = four(values + 2 * (all >> 32 & 0xffff)), &d = four(values + 2 * (all >> 48));
    Nodes<Real, 4> joined = {};  // unchanged if never called
#if defined(DIMPLE_ASSEMBLY)
    // Loads into lanes: what compilers make of shuffles waits for the one port that shuffles.
    asm("vbroadcastf32x4 %1, %0" : "=v"(joined) : "m"(a));
    asm("vbroadcastf32x4 %1, %0%{%2%}" : "+v"(joined) : "m"(b), "Yk"(std::uint16_t{0x00f0}));
    asm("vbroadcastf32x4 %1, %0%{%2%}" : "+v"(joined) : "m"(c), "Yk"(std::uint16_t{0x0f00}));
    asm("vbroadcastf32x4 %1, %0%{%2%}" : "+v"(joined) : "m"(d), "Yk"(std::uint16_t{0xf000}));
#endif
    return joined;
  }
}

/// Adds to the numbers of `nodes` nodes in `values`, to one after the other: two may be the same.
template <int nodes, class Real>
[[gnu::always_inline]] inline void scatter_add(Real* values, const std::uint16_t* twice,
                                               const Nodes<Real, nodes>& more) {
  if constexpr (nodes == 1) four(values + 2 * twice[0]) += more;
  if constexpr (nodes == 2) {
    four(values + 2 * twice[0]) += part<0>(more);
    four(values + 2 * twice[1]) += part<1>(more);
  }
  if constexpr (nodes == 4) {
    std::uint64_t all;  // the four numbers with one load
    std::memcpy(&all, twice, sizeof all);
    four(values + 2 * (all & 0xffff)) += part<0>(more);
    four(values + 2 * (all >> 16 & 0xffff)) += part<1>(more);
    four(values + 2 * (all >> 32 & 0xffff)) += part<2>(more);
    four(values + 2 * (all >> 48)) += part<3>(more);
  }
}

/// Gradients of `nodes` nodes, each number in all four lanes of its node; a single node's are plain numbers.
template <class Real, int nodes>
struct Gradients {
  std::conditional_t<nodes == 1, Real, Nodes<Real, nodes>> x, y, z;
};
/// `d` [3 x nodes]; what follows in the quad is loaded too, and not used.
template <int nodes, class Real>
[[gnu::always_inline]] inline Gradients<Real, nodes> load_gradients(const Real (*d)[3]) {
  if constexpr (nodes == 1) return {d[0][0], d[0][1], d[0][2]};
  if constexpr (nodes == 2) {
    const auto all = join<Real>(load<4>(d[0]), load<4>(d[1]));
    return {__builtin_shufflevector(all, all, 0, 0, 0, 0, 4, 4, 4, 4),
            __builtin_shufflevector(all, all, 1, 1, 1, 1, 5, 5, 5, 5),
            __builtin_shufflevector(all, all, 2, 2, 2, 2, 6, 6, 6, 6)};
  }
  if constexpr (nodes == 4) {
    auto all = load<16>(d[0]);
#if defined(DIMPLE_ASSEMBLY)
    asm("" : "+v"(all));  // loaded once, not once for each of the three
#endif
    return {__builtin_shufflevector(all, all, 0, 0, 0, 0, 3, 3, 3, 3, 6, 6, 6, 6, 9, 9, 9, 9),
            __builtin_shufflevector(all, all, 1, 1, 1, 1, 4, 4, 4, 4, 7, 7, 7, 7, 10, 10, 10, 10),
            __builtin_shufflevector(all, all, 2, 2, 2, 2, 5, 5, 5, 5, 8, 8, 8, 8, 11, 11, 11, 11)};
  }
}

/// Rows of four become columns of four.
template <class Real>
[[gnu::always_inline]] inline void transpose(const Pack<Real, 4>& r0, const Pack<Real, 4>& r1,
                                             const Pack<Real, 4>& r2, const Pack<Real, 4>& r3,
                                             Pack<Real, 4>* column) {
  const Pack<Real, 4> low01 = __builtin_shufflevector(r0, r1, 0, 4, 1, 5),
                      low23 = __builtin_shufflevector(r2, r3, 0, 4, 1, 5),
                      high01 = __builtin_shufflevector(r0, r1, 2, 6, 3, 7),
                      high23 = __builtin_shufflevector(r2, r3, 2, 6, 3, 7);
  column[0] = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
  column[1] = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
  column[2] = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
  column[3] = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
}

/// x, y and z of `count` points become a column of each. Halves are read from memory, where a register is
/// anyway without AVX.
template <class Real, int count>
[[gnu::always_inline]] inline void columns(const Pack<Real, count>& x, const Pack<Real, count>& y,
                                           const Pack<Real, count>& z, Pack<Real, 4>* column) {
  const auto *first = reinterpret_cast<const Real*>(&x), *second = reinterpret_cast<const Real*>(&y),
             *third = reinterpret_cast<const Real*>(&z);
  const Pack<Real, 4> padding = {};
  for (int half = 0; half < count / 4; ++half)
    transpose<Real>(four(first, half), four(second, half), four(third, half), padding, column + 4 * half);
}

}  // namespace dimple::wide
