"""The live demo beside another one."""

from stepdiag.demo.live import page_port


def test_two_demos_that_begin_at_once_have_two_ports() -> None:
    """Neither listens yet: that the usual port is free is what both find."""
    with page_port() as one, page_port() as other:
        assert one != other
