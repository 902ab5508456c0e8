"""Many machines over years: an archive of finished surveys, the changes and their times, and the
old logs solved again.

In: folders of finished surveys. Out: a store of files (a folder, or anything fsspec opens), and its
contents as tables, JSON and a page. No part of this package runs while a machine is measured. The
package needs the extra ``stepdiag[fleet]``; only functions of `cli` import it.
"""
