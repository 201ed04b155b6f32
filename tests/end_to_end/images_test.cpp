// Images written by a run, read back and used by ITK as 3D Slicer does.

#include <itkDisplacementFieldTransform.h>
#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkLinearInterpolateImageFunction.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <itkResampleImageFilter.h>
#include <itkVectorLinearInterpolateImageFunction.h>
#include <nifti1_io.h>
#include <sys/wait.h>
#include <zlib.h>

#include <cstring>

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

using Grey = itk::Image<float, 3>;
using Labels = itk::Image<int, 3>;
using Vectors = itk::Image<itk::Vector<double, 3>, 3>;
using Transform = itk::DisplacementFieldTransform<double, 3>;

itk::ImageIOBase::Pointer format_of(const std::string& file) {
  if (file.ends_with(".nrrd")) return itk::NrrdImageIO::New().GetPointer();
  if (file.ends_with(".mha")) return itk::MetaImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

template <class Image>
typename Image::Pointer read(const fs::path& file) {
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetImageIO(format_of(file));
  reader->SetFileName(file.string());
  reader->Update();
  return reader->GetOutput();
}

template <class Image>
void write_image(const fs::path& file, Image* image) {
  const auto writer = itk::ImageFileWriter<Image>::New();
  writer->SetImageIO(format_of(file));
  writer->SetFileName(file.string());
  writer->SetInput(image);
  writer->UseCompressionOn();
  writer->Update();
}

template <class Image>
typename Image::Pointer image_with(const std::array<Index, 3>& size, const Mat3& directions,
                                   const Vec3& spacing, const Vec3& origin) {
  const auto image = Image::New();
  typename Image::RegionType region;
  typename Image::DirectionType direction;
  typename Image::PointType at;
  typename Image::SpacingType step;
  for (unsigned a = 0; a < 3; ++a) {
    region.SetSize(a, static_cast<itk::SizeValueType>(size[a]));
    at[a] = origin[a];
    step[a] = spacing[a];
    for (unsigned r = 0; r < 3; ++r) direction(r, a) = directions(r, a);
  }
  image->SetRegions(region);
  image->SetDirection(direction);
  image->SetOrigin(at);
  image->SetSpacing(step);
  image->Allocate(true);
  return image;
}

template <class Image>
void for_each_voxel(Image* image, const auto& visit) {
  const auto size = image->GetLargestPossibleRegion().GetSize();
  typename Image::IndexType at;
  for (at[2] = 0; at[2] < static_cast<Index>(size[2]); ++at[2])
    for (at[1] = 0; at[1] < static_cast<Index>(size[1]); ++at[1])
      for (at[0] = 0; at[0] < static_cast<Index>(size[0]); ++at[0]) {
        typename Image::PointType place;
        image->TransformIndexToPhysicalPoint(at, place);
        visit(at, Vec3(place[0], place[1], place[2]));
      }
}

/// Directions of the stored axes of an image in the patient.
struct Orientation {
  const char* name;
  Mat3 directions;
  const char* suffix;
  int layers = 2;  ///< voxels along the third axis are so many times as thick as 1.5 mm
};

std::vector<Orientation> orientations() {
  const Mat3 lps = Mat3::Identity(), ras = Vec3(-1, -1, 1).asDiagonal(), las = Vec3(1, -1, 1).asDiagonal();
  const Mat3 oblique = Eigen::AngleAxisd(0.35, Vec3(1, -2, 1.5).normalized()).toRotationMatrix();
  Mat3 sagittal;  // first axis posterior, second superior, third right
  sagittal << 0, 0, -1, 1, 0, 0, 0, 1, 0;
  return {{"LPS", lps, ".nrrd"},
          {"RAS", ras, ".nii.gz"},
          {"oblique", oblique, ".mha"},
          {"left-handed", las, ".nii.gz"},
          {"sagittal", sagittal, ".nrrd"}};
}

class Images : public InFolder {
 protected:
  /// A dome 50 mm wide and 26 mm high with its flat side below, on an image with these axes. An MRI on the
  /// same grid has a bright spot on the dome's axis, 6 mm below its top.
  void make_dome(const Orientation& how) const {
    const Vec3 spacing(1.5, 1.5, 1.5 * how.layers);
    const std::array<Index, 3> size{44, 44, 44 / how.layers};
    const Vec3 half(21.5, 21.5, 0.5 * static_cast<double>(size[2] - 1));
    const Vec3 origin = middle - how.directions * half.cwiseProduct(spacing);
    const auto labels = image_with<itk::Image<unsigned char, 3>>(size, how.directions, spacing, origin);
    const auto grey = image_with<Grey>(size, how.directions, spacing, origin);
    for_each_voxel(labels.GetPointer(), [&](const auto& at, const Vec3& place) {
      const Vec3 x = place - middle + Vec3(0, 0, 12);
      if (x.z() > 0.0 && x.cwiseQuotient(Vec3(25, 22, 26)).norm() < 1.0) labels->SetPixel(at, 1);
      grey->SetPixel(at,
                     static_cast<float>(100.0 + 900.0 * std::exp(-(place - spot()).squaredNorm() / 18.0)));
    });
    write_image(folder / (std::string("labels") + how.suffix), labels.GetPointer());
    write_image(folder / (std::string("mri") + how.suffix), grey.GetPointer());
  }
  const Vec3 middle{12.0, -34.0, 51.0};
  Vec3 spot() const { return middle + Vec3(0, 0, 8); }

  /// Centre of the brightness above the background [mm].
  Vec3 centre_of(Grey* image) const {
    Vec3 sum = Vec3::Zero();
    double all = 0.0;
    for_each_voxel(image, [&](const auto& at, const Vec3& place) {
      const double bright = std::max(0.0, static_cast<double>(image->GetPixel(at)) - 130.0);
      sum += bright * place;
      all += bright;
    });
    return sum / all;
  }

  Grey::Pointer resampled_by_itk(const fs::path& transform_file, Grey* moving) const {
    const auto transform = Transform::New();
    transform->SetDisplacementField(read<Vectors>(transform_file));
    const auto filter = itk::ResampleImageFilter<Grey, Grey, double>::New();
    filter->SetInput(moving);
    filter->SetTransform(transform);
    filter->SetReferenceImage(moving);
    filter->UseReferenceImageOn();
    filter->Update();
    return filter->GetOutput();
  }
};

template <class A, class B>
void expect_same_grid(const A* a, const B* b) {
  EXPECT_EQ(a->GetLargestPossibleRegion().GetSize(), b->GetLargestPossibleRegion().GetSize());
  for (unsigned r = 0; r < 3; ++r) {
    EXPECT_NEAR(a->GetOrigin()[r], b->GetOrigin()[r], 1e-5);
    EXPECT_NEAR(a->GetSpacing()[r], b->GetSpacing()[r], 1e-6);
    for (unsigned c = 0; c < 3; ++c) EXPECT_NEAR(a->GetDirection()(r, c), b->GetDirection()(r, c), 1e-6);
  }
}

TEST_F(Images, ALandmarkMovesAsTheToolPressesHoweverTheImageIsStored) {
  for (const Orientation& how : orientations()) {
    SCOPED_TRACE(how.name);
    const std::string suffix = how.suffix, out = std::string("out_") + how.name;
    make_dome(how);
    good("run labels" + suffix + " -o " + out +
         " --nodes 600 --depth 6mm --frames 3 --base inferior --indent-at 12,-34,top --band off --write "
         "images --warp mri" +
         suffix + " -q");
    const fs::path images = folder / out / "images";
    const auto mri = read<Grey>(folder / ("mri" + suffix)),
               warped = read<Grey>(images / ("warped_mri" + suffix));
    expect_same_grid(mri.GetPointer(), warped.GetPointer());

    // The spot moves down by most of the tool's displacement, and not sideways.
    const Json reported = summary(out);
    const auto p = reported.at("counts").at("push");
    const Vec3 approach(p[0], p[1], p[2]), moved = centre_of(warped) - centre_of(mri);
    EXPECT_GT(moved.dot(approach), 2.0) << moved.transpose();
    EXPECT_LT(moved.dot(approach), 6.0);
    EXPECT_LT((moved - moved.dot(approach) * approach).norm(), 0.7) << moved.transpose();

    // The displacement at its first place agrees; the transform maps its new place back.
    const auto forth = read<Vectors>(images / ("displacement_mm" + suffix)),
               back = read<Vectors>(images / ("transform" + suffix));
    expect_same_grid(forth.GetPointer(), mri.GetPointer());
    expect_same_grid(back.GetPointer(), mri.GetPointer());
    const auto at = [](Vectors* field, const Vec3& place) {
      const auto between = itk::VectorLinearInterpolateImageFunction<Vectors, double>::New();
      between->SetInputImage(field);
      Vectors::PointType x;
      for (unsigned r = 0; r < 3; ++r) x[r] = place[r];
      const auto v = between->Evaluate(x);
      return Vec3(v[0], v[1], v[2]);
    };
    const Vec3 u = at(forth, spot()), X = spot() + u + at(back, spot() + u);
    EXPECT_LT((u - moved).norm(), 1.0) << u.transpose();  // the spot is 6 mm wide, and u varies within it
    EXPECT_LT((X - spot()).norm(), 0.25) << X.transpose();

    // ITK, and so 3D Slicer, obtains the same image with the transform.
    const auto by_itk = resampled_by_itk(images / ("transform" + suffix), mri);
    double worst = 0.0;
    for_each_voxel(mri.GetPointer(), [&](const auto& voxel, const Vec3&) {
      worst =
          std::max(worst, std::abs(static_cast<double>(by_itk->GetPixel(voxel) - warped->GetPixel(voxel))));
    });
    EXPECT_LT(worst, 1.0);  // of 900; the transform is rounded to a micrometre
    RecordProperty(std::string("difference_from_itk_") + how.name, std::to_string(worst));

    // The number of labelled voxels agrees with the volume of the deformed body.
    const auto labels = read<Labels>(images / ("labels" + suffix));
    expect_same_grid(labels.GetPointer(), mri.GetPointer());
    std::int64_t count = 0;
    for_each_voxel(labels.GetPointer(),
                   [&](const auto& voxel, const Vec3&) { count += labels->GetPixel(voxel) == 1; });
    const double counted = static_cast<double>(count) * 1.5 * 1.5 * 1.5 * how.layers;
    EXPECT_NEAR(counted, reported.at("images").at("labels_mm3"), 1e-3 * counted);
    EXPECT_NEAR(counted / reported.at("images").at("deformed_mm3").get<double>(), 1.0, 0.01);
    EXPECT_EQ(read_label_image(images / ("labels" + suffix)).format,
              read_label_image(folder / ("labels" + suffix)).format);

    // Stress and det F are given on the body at rest.
    const auto original = read<Labels>(folder / ("labels" + suffix));
    const auto mises = read<Grey>(images / ("von_mises_Pa" + suffix)),
               J = read<Grey>(images / ("jacobian" + suffix));
    std::int64_t body = 0, stressed = 0;
    for_each_voxel(original.GetPointer(), [&](const auto& voxel, const Vec3&) {
      EXPECT_EQ(mises->GetPixel(voxel) != 0.0f, J->GetPixel(voxel) != 0.0f);  // not at the patch edge
      body += original->GetPixel(voxel) == 1;
      stressed += mises->GetPixel(voxel) != 0.0f;
    });
    EXPECT_NEAR(static_cast<double>(stressed) / static_cast<double>(body), 1.0, 0.03);
    // Voxels without convergence are at the sharp patch edge only.
    EXPECT_LE(100 * reported.at("images").at("unsettled_voxels").get<int>(),
              reported.at("images").at("solved_voxels").get<int>());
    EXPECT_GT(reported.at("images").at("wall_s"), 0.0);
  }
}

// Labels at rest are kept although the surface smooths the voxels' staircase.
TEST_F(Images, LabelsOfWhatHasHardlyMovedAreThoseAtRest) {
  make_dome({"oblique", Eigen::AngleAxisd(0.35, Vec3(1, -2, 1.5).normalized()).toRotationMatrix(), ".nrrd"});
  good("run labels.nrrd -o out -q --nodes 500 --band off --depth 0.01mm --write images");
  const auto before = read<Labels>(folder / "labels.nrrd"),
             after = read<Labels>(folder / "out/images/labels.nrrd");
  int tissue = 0, others = 0;
  for_each_voxel(before.GetPointer(), [&](const auto& at, const Vec3&) {
    tissue += before->GetPixel(at) > 0;
    others += before->GetPixel(at) != after->GetPixel(at);
  });
  // Sides follow the scan, which is rotated by 17 degrees; gravity follows the patient.
  for (const auto& [base, said] : {std::pair{"inferior", true}, {"0,0,-1", false}}) {
    const Ran ran = dimple(folder, std::string("model labels.nrrd -o m --force --nodes 300 --base ") + base);
    EXPECT_EQ(ran.err.find("axes are rotated by 17 degrees against the patient's") != std::string::npos, said)
        << ran.err;
    EXPECT_EQ(ran.err.find("gravity, and supports, loads and films on a side, follow the patient's") !=
                  std::string::npos,
              said)
        << ran.err;
  }
  ASSERT_GT(tissue, 4000);
  EXPECT_LE(others, 3);
}

// The NIfTI standard requires vectors on the fifth axis and intent 1007, which ITK and ANTs read as LPS.
TEST_F(Images, AVectorImageInNiftiIsWhatItkAndAntsTakeForADisplacementField) {
  make_dome(orientations()[1]);
  good("run labels.nii.gz -o out --nodes 400 --depth 2mm --frames 2 --band off --write images -q");
  for (const char* name : {"displacement_mm", "transform"}) {
    SCOPED_TRACE(name);
    nifti_1_header h{};
    const gzFile in = gzopen((folder / "out/images" / (std::string(name) + ".nii.gz")).c_str(), "rb");
    ASSERT_EQ(gzread(in, &h, sizeof h), static_cast<int>(sizeof h));
    gzclose(in);
    EXPECT_EQ(h.intent_code, NIFTI_INTENT_VECTOR);
    EXPECT_EQ(h.dim[0], 5);
    EXPECT_EQ(h.dim[4], 1);
    EXPECT_EQ(h.dim[5], 3);
    EXPECT_EQ(h.datatype, NIFTI_TYPE_FLOAT32);
    EXPECT_GT(h.sform_code, 0);
  }
}

TEST_F(Images, AnMriOnAGridOfItsOwnKeepsThatGridAndItsType) {
  make_dome(orientations()[0]);
  const auto mri = image_with<itk::Image<short, 3>>({40, 50, 60}, Vec3(-1, -1, 1).asDiagonal(),
                                                    Vec3(1.1, 0.9, 1), middle + Vec3(21, 22, -30));
  for_each_voxel(mri.GetPointer(), [&](const auto& at, const Vec3& place) {
    mri->SetPixel(at, static_cast<short>(std::lround(-1000.0 + 20.0 * (place.z() - 20.0))));
  });
  write_image(folder / "mri.nii.gz", mri.GetPointer());
  write_image(folder / "atlas.mha", mri.GetPointer());
  good(
      "run labels.nrrd -o out --nodes 600 --depth 6mm --frames 2 --base inferior --indent-at 12,-34,top "
      "--band off "
      "--write force --warp mri.nii.gz --warp-labels atlas.mha -q");
  EXPECT_FALSE(fs::exists(folder / "out/images/transform.nrrd"));  // the image was not requested
  const auto warped = read<itk::Image<short, 3>>(folder / "out/images/warped_mri.nii.gz");
  const auto nearest = read<itk::Image<short, 3>>(folder / "out/images/warped_atlas.mha");
  expect_same_grid(warped.GetPointer(), mri.GetPointer());
  expect_same_grid(nearest.GetPointer(), mri.GetPointer());
  const auto reader = itk::NiftiImageIO::New();
  reader->SetFileName((folder / "out/images/warped_mri.nii.gz").string());
  reader->ReadImageInformation();
  EXPECT_EQ(reader->GetComponentType(), itk::IOComponentEnum::SHORT);

  // Grey values rise with z: they become larger where tissue moves down.
  int brighter = 0, darker = 0, of_the_ramp = 0, voxels = 0;
  for_each_voxel(mri.GetPointer(), [&](const auto& at, const Vec3& place) {
    const Vec3 x = place - middle;
    if (x.head<2>().norm() > 4.0 || x.z() < -4.0 || x.z() > 6.0) return;
    brighter += warped->GetPixel(at) > mri->GetPixel(at) + 10;
    darker += warped->GetPixel(at) < mri->GetPixel(at);
    of_the_ramp += (nearest->GetPixel(at) + 1000) % 20 == (mri->GetPixel(at) + 1000) % 20;
    ++voxels;
  });
  EXPECT_GT(brighter, 9 * voxels / 10);
  EXPECT_EQ(darker, 0);
  EXPECT_EQ(of_the_ramp, voxels);  // no value that the atlas does not have
}

TEST_F(Images, OfEachFrameAreNumberedAndAModelsRunWarpsAnMri) {
  make_dome(orientations()[1]);
  good(
      "run labels.nii.gz -o out --nodes 400 --depth 3mm --frames 3 --band off --write images,model "
      "--write-frames all "
      "--warp mri.nii.gz -q");
  for (const char* name :
       {"displacement_mm", "transform", "labels", "jacobian", "von_mises_Pa", "warped_mri"})
    for (int frame = 0; frame <= 3; ++frame)
      EXPECT_TRUE(fs::exists(folder / "out/images" /
                             (std::string(name) + "_000" + std::to_string(frame) + ".nii.gz")));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "out/images"), fs::directory_iterator()), 24);
  const auto first = read<Grey>(folder / "out/images/warped_mri_0000.nii.gz"),
             last = read<Grey>(folder / "out/images/warped_mri_0003.nii.gz"),
             mri = read<Grey>(folder / "mri.nii.gz");
  for_each_voxel(mri.GetPointer(),
                 [&](const auto& at, const Vec3&) { ASSERT_EQ(first->GetPixel(at), mri->GetPixel(at)); });

  good("solve out/model -o solved --depth 3mm --frames 3 --write force --warp mri.nii.gz -q");
  EXPECT_EQ(text_of(folder / "solved/images/warped_mri.nii.gz"),
            text_of(folder / "out/images/warped_mri_0003.nii.gz"));

  // A new run removes files that it does not write again.
  good("run labels.nii.gz -o out --force --nodes 400 --depth 3mm --frames 3 --band off --write force -q");
  EXPECT_FALSE(fs::exists(folder / "out/images"));
}

// Ctrl-C while images are written: the force is kept, no file is incomplete, and --resume writes the images.
TEST_F(Images, AreGivenUpWithinTwoSecondsAndMadeByAResumedRun) {
  good("phantom brain.nii.gz --spacing 0.8 -q");
  const std::string line =
      "run brain.nii.gz -o out --nodes 400 --depth 2mm --frames 2 --band off --write images -q";
  int interrupted = 0;
  for (const int after : {0, 400}) {
    SCOPED_TRACE(after);
    fs::remove_all(folder / "out");
    Program program(folder, {"run", "brain.nii.gz", "-o", "out", "--nodes", "400", "--depth", "2mm",
                             "--frames", "2", "--band", "off", "--write", "images", "-q"});
    program.wait_until_it_listens();
    while (program.running() && !fs::exists(folder / "out/images"))
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    std::this_thread::sleep_for(std::chrono::milliseconds(after));
    const double before_s = program.cpu_s();
    program.send(SIGINT);
    const Ran ran = program.wait();
    EXPECT_LT(ran.cpu_s - before_s, cpu_of(2.0));
    EXPECT_TRUE(ran.code == 130 || ran.code == 0) << ran.code << ran.err;
    for (const auto& entry : fs::recursive_directory_iterator(folder / "out"))
      EXPECT_TRUE(entry.path().filename() == ".dimple_files" ||
                  entry.path().filename().string().front() != '.')
          << entry;
    if (ran.code != 130) continue;
    ++interrupted;
    EXPECT_EQ(summary().at("status"), "interrupted");
    EXPECT_TRUE(fs::exists(folder / "out/force.csv"));
  }
  EXPECT_GE(interrupted, 1);
  good(line + " --resume");
  EXPECT_EQ(summary().at("status"), "finished");
  EXPECT_TRUE(fs::exists(folder / "out/images/transform.nii.gz"));
}

}  // namespace
}  // namespace dimple
