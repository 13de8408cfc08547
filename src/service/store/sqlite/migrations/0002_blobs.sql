-- Small files of jobs: of the upload until the job ends, of the result from then on.
CREATE TABLE blobs (
    job   INTEGER NOT NULL,
    name  TEXT    NOT NULL,
    bytes BLOB    NOT NULL,
    PRIMARY KEY (job, name)
) STRICT;
