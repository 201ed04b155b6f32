// What ParaView shows of a result. Its package cannot be installed together with libvtk9-dev; tests/end_to_end/
// paraview_root puts it beside the system, and DIMPLE_PVPYTHON names its pvpython.

#include <gtest/gtest.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::string pvpython() {
  if (const char* named = std::getenv("DIMPLE_PVPYTHON")) return named;
  return std::system("command -v pvpython >/dev/null 2>&1") == 0 ? "pvpython" : "";
}

/// Shares of a picture's pixels.
struct Shares {
  double paper = 0.0;  ///< white
  double dark = 0.0;   ///< as the largest displacement and stress are drawn
};

Shares shares_of(const fs::path& picture) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(picture.c_str());
  reader->Update();
  vtkImageData* image = reader->GetOutput();
  int size[3];
  image->GetDimensions(size);
  Shares shares;
  const double each = 1.0 / (static_cast<double>(size[0]) * size[1]);
  for (int y = 0; y < size[1]; ++y)
    for (int x = 0; x < size[0]; ++x) {
      const auto* p = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
      if (std::min({p[0], p[1], p[2]}) > 250) shares.paper += each;
      if (p[0] > 55 && p[0] < 160 && p[1] < 60 && p[2] > 70 && p[2] < 125) shares.dark += each;
    }
  return shares;
}

TEST(ParaView, ShowsTheLastFrameOfAResultByOneFileWhereverTheFolderLies) {
  const std::string program = pvpython();
  if (program.empty())
    GTEST_SKIP() << "there is no pvpython: tests/end_to_end/paraview_root FOLDER fetches one, and "
                    "DIMPLE_PVPYTHON=FOLDER/pvpython names it";
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom brain.nrrd --spacing 2 --two-labels -q").code, 0);
  const Ran ran = dimple(
      folder, "run brain.nrrd -o out -q --nodes 1000 --depth 6mm --frames 3 --write surface --band off");
  ASSERT_EQ(ran.code, 0) << ran.err;
  fs::create_directories(folder / "elsewhere");
  fs::rename(folder / "out", folder / "elsewhere" / "moved here");

  // A number of its own: a display that was just given up is taken and then gone.
  const std::string display = std::getenv("DISPLAY") ? "" : "xvfb-run -a -n $((100 + $$ % 900)) ";
  const auto draw = [&] {
    return Program(folder,
                   {"-c", display + program + " 'elsewhere/moved here/view.py' last.png -1 first.png 0"},
                   "/bin/sh")
        .wait();
  };
  Ran drawn = draw();
  // On a busy machine the display is not always there; that says nothing of the picture.
  for (int again = 0; again < 3 && drawn.err.find("bad X server connection") != std::string::npos; ++again)
    drawn = draw();
  ASSERT_EQ(drawn.code, 0) << drawn.err;
  for (const char* word : {"ERR|", "WARN|", "Traceback", "Error"})
    EXPECT_EQ(drawn.err.find(word), std::string::npos) << drawn.err;
  const Shares last = shares_of(folder / "last.png"), first = shares_of(folder / "first.png");
  for (const Shares& shares : {first, last}) {
    EXPECT_GT(shares.paper, 0.4);
    EXPECT_LT(shares.paper, 0.9);
  }
  EXPECT_GT(last.dark, 2e-3) << "the body is deformed, and its colours tell";
  EXPECT_GT(first.dark, 0.0) << "the legends alone";
  EXPECT_LT(first.dark, 0.5 * last.dark);
}

}  // namespace
}  // namespace dimple
