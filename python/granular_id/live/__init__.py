"""From sensor packets to a named material while the tool moves.

A *source* (a sensor, a file played again, a simulation) writes wrenches into a `WrenchBuffer`; a *capture* waits
for the motion and takes the rows that belong to one push; a *recorder* stores them, `identify` names them while
they arrive. The names below are loaded when first used.
"""

from __future__ import annotations
