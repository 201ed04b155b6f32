#include <vtkNew.h>
#include <vtkSmartPointer.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLUtilities.h>

#include <map>

#include "tests/end_to_end/in_folder.hpp"

// These tests act as 3D Slicer: it reads the output of --xml, makes a panel of it, and calls the program with
// all values.

namespace dimple {
namespace {

class Slicer : public testing::Test {
 protected:
  const fs::path folder = fresh_folder();
  const std::string xml = dimple(folder, "--xml").out;
  vtkSmartPointer<vtkXMLDataElement> root =
      vtkSmartPointer<vtkXMLDataElement>::Take(vtkXMLUtilities::ReadElementFromString(xml.c_str()));

  // All parameters of all groups.
  std::vector<vtkXMLDataElement*> parameters() const {
    std::vector<vtkXMLDataElement*> all;
    for (int g = 0; g < root->GetNumberOfNestedElements(); ++g) {
      vtkXMLDataElement* group = root->GetNestedElement(g);
      if (std::string(group->GetName()) != "parameters") continue;
      for (int p = 0; p < group->GetNumberOfNestedElements(); ++p)
        if (group->GetNestedElement(p)->FindNestedElementWithName("name"))
          all.push_back(group->GetNestedElement(p));
    }
    return all;
  }
  static std::string text(vtkXMLDataElement* parent, const char* name) {
    vtkXMLDataElement* child = parent->FindNestedElementWithName(name);
    const char* data = child ? child->GetCharacterData() : nullptr;
    return data ? std::regex_replace(data, std::regex("^\\s+|\\s+$"), "") : "";
  }

  // Values of a panel with all defaults, except for those of `chosen`, by flag.
  std::vector<std::string> command_line(const std::map<std::string, std::string>& chosen) const {
    std::vector<std::string> words;
    for (vtkXMLDataElement* parameter : parameters()) {
      const std::string kind = parameter->GetName(), flag = text(parameter, "longflag");
      if (flag.empty()) continue;
      const auto other = chosen.find(flag);
      if (kind == "boolean") {
        if (text(parameter, "default") == "true") words.push_back(flag);
      } else if (other != chosen.end()) {
        words.insert(words.end(), {flag, other->second});
      } else if (kind != "point" && kind != "file" &&
                 kind != "directory") {  // these are left out where empty
        words.insert(words.end(), {flag, text(parameter, "default")});
      }
    }
    return words;
  }
};

// Elements of the Slicer Execution Model, as its documentation and ModuleDescription.xsd name them. That
// schema itself describes less than 3D Slicer reads (no channel of a directory, no hidden point), so it is
// not the reference here.
TEST_F(Slicer, TheDescriptionHasTheElementsOfTheExecutionModel) {
  ASSERT_TRUE(root) << xml;
  ASSERT_EQ(std::string(root->GetName()), "executable");
  EXPECT_EQ(xml, dimple(folder, "run --xml").out);
  const std::vector<std::string> head = {"category",          "title",   "description", "version",
                                         "documentation-url", "license", "contributor", "acknowledgements"};
  for (std::size_t k = 0; k < head.size(); ++k)
    EXPECT_EQ(root->GetNestedElement(static_cast<int>(k))->GetName(), head[k]);
  for (int k = static_cast<int>(head.size()); k < root->GetNumberOfNestedElements(); ++k)
    EXPECT_EQ(std::string(root->GetNestedElement(k)->GetName()), "parameters");

  const std::set<std::string> common = {"name", "label", "description", "longflag", "default"};
  const std::map<std::string, std::set<std::string>> more = {{"integer", {"constraints"}},
                                                             {"double", {"constraints", "channel"}},
                                                             {"boolean", {}},
                                                             {"string", {}},
                                                             {"string-enumeration", {"element"}},
                                                             {"point", {}},
                                                             {"file", {"channel"}},
                                                             {"directory", {"channel"}},
                                                             {"image", {"channel", "index"}}};
  std::set<std::string> names, flags;
  for (vtkXMLDataElement* parameter : parameters()) {
    const std::string kind = parameter->GetName(), name = text(parameter, "name"),
                      flag = text(parameter, "longflag");
    SCOPED_TRACE(name);
    ASSERT_TRUE(more.count(kind)) << kind;
    for (int k = 0; k < parameter->GetNumberOfNestedElements(); ++k) {
      const std::string part = parameter->GetNestedElement(k)->GetName();
      EXPECT_TRUE(common.count(part) || more.at(kind).count(part)) << part;
    }
    EXPECT_TRUE(std::regex_match(name, std::regex("[A-Za-z_][A-Za-z0-9_]*")));
    EXPECT_TRUE(names.insert(name).second) << "a name that is not its own";
    EXPECT_FALSE(text(parameter, "label").empty());
    EXPECT_FALSE(text(parameter, "description").empty());
    if (!flag.empty()) {
      EXPECT_TRUE(flags.insert(flag).second) << flag;
    }
    // Only parameters with a place on the command line, or returned in a file, have no flag.
    if (flag.empty()) {
      EXPECT_TRUE(kind == "image" || text(parameter, "channel") == "output");
    }
    if (kind == "string-enumeration") {
      std::set<std::string> words;
      for (int k = 0; k < parameter->GetNumberOfNestedElements(); ++k)
        if (std::string(parameter->GetNestedElement(k)->GetName()) == "element")
          words.insert(parameter->GetNestedElement(k)->GetCharacterData());
      EXPECT_TRUE(words.count(text(parameter, "default")));
    }
    if (kind == "image") {
      EXPECT_STREQ(parameter->GetAttribute("type"), "label");
    }
    if (kind == "point") {
      EXPECT_STREQ(parameter->GetAttribute("coordinateSystem"), "lps");
    }
  }
  // The panel has all options of the command line except those without sense in a panel.
  const std::string help = dimple(folder, "run --help-all").out;
  const std::set<std::string> elsewhere = {"--help",   "--output",  "--resume",    "--explain",
                                           "--config", "--set",     "--quiet",     "--verbose",
                                           "--json",   "--threads", "--time-limit"};
  const std::regex listed("\n  (?:-[a-z],)?(--[a-z-]+)");
  int compared = 0;
  for (auto flag = std::sregex_iterator(help.begin(), help.end(), listed); flag != std::sregex_iterator();
       ++flag) {
    if (elsewhere.count((*flag)[1]) || (*flag)[1] == "--help-all") continue;
    EXPECT_TRUE(flags.count((*flag)[1])) << (*flag)[1];
    ++compared;
  }
  EXPECT_GT(compared, 25);
}

TEST_F(Slicer, APanelThatNobodyChangedIsTheDefaultRunAndItsValuesAreObeyed) {
  ASSERT_TRUE(root) << xml;
  dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  const std::map<std::string, std::string> small = {
      {"--nodes", "300"}, {"--depth", "1.0"}, {"--frames", "4"}, {"--write", "force"}, {"--out", "panel"}};
  std::vector<std::string> words = command_line(small);
  words.insert(words.end(), {"--returnparameterfile", "returned.txt", "block.nrrd"});
  const Ran ran = good(folder, words);
  EXPECT_THAT(ran.err, HasSubstr("swine brain (Horton et al. 2007), as no material was given"));
  const Ran plain = dimple(folder, "run block.nrrd -o plain --nodes 300 --depth 1 --frames 4 --write force");
  EXPECT_EQ(text_of(folder / "panel/force.csv"), text_of(folder / "plain/force.csv"));

  EXPECT_THAT(ran.out, testing::StartsWith("<filter-start>\n<filter-name>dimple</filter-name>\n"));
  EXPECT_THAT(ran.out, testing::EndsWith("</filter-end>\n"));
  const std::regex progress("<filter-progress>([0-9.]+)</filter-progress>");
  double before = 0.0;
  int reported = 0;
  for (auto line = std::sregex_iterator(ran.out.begin(), ran.out.end(), progress);
       line != std::sregex_iterator(); ++line, ++reported) {
    const double fraction = std::stod((*line)[1]);
    EXPECT_GE(fraction, before);
    EXPECT_LT(fraction, 1.0);
    before = fraction;
  }
  EXPECT_GE(reported, 8);
  EXPECT_THAT(text_of(folder / "returned.txt"),
              testing::MatchesRegex("force_N = 0\\.0[0-9]+\nindentation_mm = 1\nlow_N = -1\nhigh_N = -1\n"));

  // Second run: a point and other values.
  std::map<std::string, std::string> chosen = small;
  chosen["--young"] = "900.0";
  chosen["--indent-at"] = "-10,5,30";
  chosen["--out"] = "chosen";
  words = command_line(chosen);
  words.push_back("block.nrrd");
  good(folder, words);
  good(folder,
       "run block.nrrd -o same --nodes 300 --depth 1 --frames 4 --write force --young 900 --indent-at "
       "-10,5,30");
  EXPECT_EQ(text_of(folder / "chosen/force.csv"), text_of(folder / "same/force.csv"));
}

}  // namespace
}  // namespace dimple
