// dimple: from a label image to a force curve.
//
// Sample runs (ctest runs every line that starts with a dollar sign, in a folder of its own next to
// sample_data):
//   $ dimple phantom block.nrrd --shape block --size 60,60,30 --spacing 3
//   $ dimple info block.nrrd
//   $ dimple model block.nrrd -o block_model --nodes 500
//   $ dimple solve block_model -o block_results --depth 0.5mm --rate 10mm/s
//   $ dimple run block.nrrd -o block_run --nodes 500 --depth 0.5mm --rate 10mm/s --set material.mu=300Pa

#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>  // defines __GLIBC__
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "apps/commands/command_line.hpp"

namespace {

// Opens a closed stderr (2>&-): the next file would get its number, and messages would go there.
void open_where_closed(int descriptor) {
  if (fcntl(descriptor, F_GETFD) >= 0) return;
  const int nowhere = open("/dev/null", O_RDWR);
  if (nowhere < 0 || nowhere == descriptor) return;
  dup2(nowhere, descriptor);
  close(nowhere);
}

}  // namespace

int main(int argc, char** argv) {
  open_where_closed(STDERR_FILENO);
  // Each stage reuses the memory freed by the one before; new pages cost up to a fifth of its time.
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 128 << 20);
#endif
  return dimple::command_line(argc, argv, dimple::program_parts());
}
