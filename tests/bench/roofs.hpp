#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace dimple {

// What this processor can do at most, whatever the program: measured by loops that do nothing else, in the
// widest registers that it has.

/// Reads all of it, in pieces of 512 bytes; aligned to 64. Returns something that depends on every number.
std::int64_t read_all(std::span<const std::int64_t> numbers);

/// `rounds` rounds of independent x <- x a + b, fused where the processor can; returns how many floating
/// point operations that were.
double multiply_add_single(std::int64_t rounds);
double multiply_add_double(std::int64_t rounds);

/// The same in registers of 32 bytes with product and sum rounded apart, as the kernels have it for the sake
/// of the same bits on every processor.
double multiply_then_add_single(std::int64_t rounds);
double multiply_then_add_double(std::int64_t rounds);

}  // namespace dimple
