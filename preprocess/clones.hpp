#pragma once

// One binary for every processor, as solver/clones.hpp says.
#ifndef DIMPLE_CLONES
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && \
    !defined(DIMPLE_NO_CLONES)
#define DIMPLE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define DIMPLE_CLONES
#endif
#endif
