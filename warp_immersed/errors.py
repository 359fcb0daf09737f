"""The two ways a run can end badly, told apart so that the command line can set its exit status."""


class InputError(ValueError):
    """Something the user gave cannot be used. The message names it, says what was found and what would be right."""


class MeshRepairWarning(UserWarning):
    """A mesh was usable only after a repair, which the message describes."""
