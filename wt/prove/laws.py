"""Every law of the hidden worlds by its name."""

from __future__ import annotations

from wt.prove import body_laws, contact_laws, drive_laws, joint_laws, moving_laws, outside_laws
from wt.prove.hidden import HiddenLaw

LAWS: dict[str, type[HiddenLaw]] = {
    **drive_laws.LAWS,
    **joint_laws.LAWS,
    **body_laws.LAWS,
    **contact_laws.LAWS,
    **moving_laws.LAWS,
    **outside_laws.LAWS,
}
