import warnings

from loopid.errors import ModelWarning, warn


def test_warnings_point_to_the_line_that_called_loopid():
    inside = {"__name__": "loopid.room", "warn": warn, "ModelWarning": ModelWarning}
    exec(compile("def deeper():\n    warn('odd', ModelWarning)\n", "room.py", "exec"), inside)
    exec(compile("def deep():\n    deeper()\n", "room.py", "exec"), inside)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        inside["deep"]()
    assert seen[0].filename == __file__
