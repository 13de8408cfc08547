-- Tenants with their quotas and tokens (hashes of them), where they are not in a file.
CREATE TABLE access (
    tenant text COLLATE "C" PRIMARY KEY,
    entry  json NOT NULL
);
-- One row: rises with every change of access, which it serialises.
CREATE TABLE access_version (version bigint NOT NULL);
INSERT INTO access_version VALUES (0);
