#include "io/vtk_messages.hpp"

#include <vtkLogger.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkSmartPointer.h>

#include <mutex>
#include <string_view>

namespace dimple {
namespace {

// Keeps what VTK would print to the terminal. An observer on the reader is not enough: the parser and the
// decompressor inside it report on their own.
class CapturedMessages : public vtkOutputWindow {
 public:
  static CapturedMessages* New() { VTK_STANDARD_NEW_BODY(CapturedMessages); }
  void DisplayText(const char* text) override {
    if (first.empty() && text != nullptr) first = text;
  }
  std::string first;  // later messages are its consequences

 protected:
  CapturedMessages() = default;
};

// VTK has one window in a process: another thread that reads or writes waits.
std::recursive_mutex one_window;

}  // namespace

struct MessageScope::Parts {
  std::lock_guard<std::recursive_mutex> alone{one_window};
  vtkNew<CapturedMessages> window;
  vtkSmartPointer<vtkOutputWindow> before = vtkOutputWindow::GetInstance();
  int displayed = vtkObject::GetGlobalWarningDisplay();
  vtkLogger::Verbosity logged = vtkLogger::GetCurrentVerbosityCutoff();
};

MessageScope::MessageScope() : parts_(std::make_unique<Parts>()) {
  vtkOutputWindow::SetInstance(parts_->window);
  vtkObject::GlobalWarningDisplayOn();
  vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
}

MessageScope::~MessageScope() {
  vtkLogger::SetStderrVerbosity(parts_->logged);
  vtkObject::SetGlobalWarningDisplay(parts_->displayed);
  vtkOutputWindow::SetInstance(parts_->before);
}

std::string MessageScope::text() const {
  std::string_view message = parts_->window->first;
  if (const auto end = message.find("): "); end != std::string_view::npos) message.remove_prefix(end + 3);
  std::string line;
  for (const char c : message) {
    const bool blank = c == ' ' || c == '\n' || c == '\t' || c == '\r';
    if (!blank) line += c;
    if (blank && !line.empty() && line.back() != ' ') line += ' ';
  }
  while (!line.empty() && (line.back() == ' ' || line.back() == '.')) line.pop_back();
  return line;
}

bool MessageScope::empty() const {
  return parts_->window->first.empty();
}

}  // namespace dimple
