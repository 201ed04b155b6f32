#pragma once

namespace dimple {

/// Whether a window can be opened here. VTK ends the program where it cannot.
bool has_display();

}  // namespace dimple
