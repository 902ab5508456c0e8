"""What strangers hand over: damaged, expensive and foreign files and streams, and every door that
they may come through."""
