"""Reports and result files. `documents` needs no plots; the pages do, and are imported when
asked."""
