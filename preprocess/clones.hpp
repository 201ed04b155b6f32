#pragma once

// Makes one binary serve every processor: the loader picks the copy that this one can run. All copies round
// alike, since nothing is reordered and products are not fused with sums.
#if defined(__x86_64__) && !defined(DIMPLE_NO_CLONES)
#define DIMPLE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define DIMPLE_CLONES
#endif
