// The heap of the programs: jemalloc on huge pages. A sixth of a run's time was the kernel handing out small
// pages.

// jemalloc reads this name before main(). Huge pages for data and for its own bookkeeping; one arena for each
// core, so that memory which one thread has freed serves another; freed pages are kept for 10 s, as the next
// stage needs them.
extern "C" {
extern const char* malloc_conf;
const char* malloc_conf = "thp:always,metadata_thp:always";
}
