#pragma once

namespace dimple {

/// Throws UsageError if no window can be opened, before VTK would end the program.
void require_display();

}  // namespace dimple
