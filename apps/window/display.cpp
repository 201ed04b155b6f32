#include "apps/window/display.hpp"

#include <X11/Xlib.h>

namespace dimple {

bool has_display() {
  ::Display* display = XOpenDisplay(nullptr);
  if (display) XCloseDisplay(display);
  return display != nullptr;
}

}  // namespace dimple
