#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace dimple {

// Limits of this processor for any program, measured by loops that do nothing else, in its widest registers.

/// Reads all of it, in pieces of 512 bytes; aligned to 64. Returns a value that depends on every number.
std::int64_t read_all(std::span<const std::int64_t> numbers);

/// Computes `rounds` rounds of independent x <- x a + b, fused if the processor can; returns the number of
/// floating point operations.
double multiply_add_single(std::int64_t rounds);
double multiply_add_double(std::int64_t rounds);

/// Rates in registers of 32 bytes with product and sum rounded separately. The kernels do this to get the
/// same bits on every processor.
double multiply_then_add_single(std::int64_t rounds);
double multiply_then_add_double(std::int64_t rounds);

}  // namespace dimple
