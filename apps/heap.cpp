// Heap of the programs: jemalloc with huge pages. Page faults fall to a quarter or less. Where the system
// hands out pages slowly that was up to 45 % of a run's time; where it does not, nothing is won or lost.

// jemalloc reads this name before main(). Huge pages serve data and jemalloc's own bookkeeping.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "thp:always,metadata_thp:always";
}
