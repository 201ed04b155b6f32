// ParaView's view of a result. Its package cannot be installed together with libvtk9-dev;
// tests/end_to_end/paraview_root installs it next to the system, and DIMPLE_PVPYTHON names its pvpython.

#include <string>

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/picture_pixels.hpp"

namespace dimple {
namespace {

std::string pvpython() {
  if (const char* named = std::getenv("DIMPLE_PVPYTHON")) return named;
  return std::system("command -v pvpython >/dev/null 2>&1") == 0 ? "pvpython" : "";
}

/// Fractions of a picture's pixels.
struct Fractions {
  double paper = 0.0;  ///< white
  double dark = 0.0;   ///< colour of the largest displacement and stress
};

Fractions fractions_of(const fs::path& picture) {
  const auto is_dark = [](int red, int green, int blue) {
    return red > 55 && red < 160 && green < 60 && blue > 70 && blue < 125;
  };
  return {fraction_of_pixels(picture, is_white), fraction_of_pixels(picture, is_dark)};
}

TEST(ParaView, ShowsTheLastFrameOfAResultByOneFileWhereverTheFolderLies) {
  const std::string program = pvpython();
  if (program.empty())
    GTEST_SKIP() << "there is no pvpython: tests/end_to_end/paraview_root FOLDER fetches one, and "
                    "DIMPLE_PVPYTHON=FOLDER/pvpython names it";
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 2 --two-labels -q");
  good(folder, "run brain.nrrd -o out -q --nodes 1000 --depth 6mm --frames 3 --write surface --band off");
  fs::create_directories(folder / "elsewhere");
  fs::rename(folder / "out", folder / "elsewhere" / "moved here");

  // A random display number, because a display that was just closed is found and then vanishes.
  const std::string display = std::getenv("DISPLAY") ? "" : "xvfb-run -a -n $((100 + $$ % 900)) ";
  const auto draw = [&] {
    return Program(folder,
                   {"-c", display + program + " 'elsewhere/moved here/view.py' last.png -1 first.png 0"},
                   "/bin/sh")
        .wait();
  };
  Ran drawn = draw();
  // On a busy machine the display may be missing, which says nothing about the picture.
  for (int again = 0; again < 3 && drawn.err.find("bad X server connection") != std::string::npos; ++again)
    drawn = draw();
  ASSERT_EQ(drawn.code, 0) << drawn.err;
  for (const char* word : {"ERR|", "WARN|", "Traceback", "Error"})
    EXPECT_THAT(drawn.err, Not(HasSubstr(word)));
  const Fractions last = fractions_of(folder / "last.png"), first = fractions_of(folder / "first.png");
  for (const Fractions& fractions : {first, last}) {
    EXPECT_GT(fractions.paper, 0.4);
    EXPECT_LT(fractions.paper, 0.9);
  }
  EXPECT_GT(last.dark, 2e-3) << "the body is deformed, and its colours tell";
  EXPECT_GT(first.dark, 0.0) << "the legends alone";
  EXPECT_LT(first.dark, 0.5 * last.dark);
  const auto is_red = [](int r, int g, int b) { return r > 200 && g < 60 && b < 60; };
  EXPECT_GT(fraction_of_pixels(folder / "last.png", is_red, {0.0, 0.7, 0.2, 1.0}), 1e-4)
      << "the axis of left";
  const auto is_ink = [](int r, int g, int b) { return r < 90 && g < 90 && b < 90; };
  EXPECT_GT(fraction_of_pixels(folder / "last.png", is_ink, {0.4, 0.9, 0.58, 1.0}), 1e-3)
      << "a scale bar and its length";
}

}  // namespace
}  // namespace dimple
