#![no_main]
//! Tables of photographs. A decoded table must survive encoding and decoding.

use std::path::Path;

use gonio_io::table::Table;
use libfuzzer_sys::fuzz_target;

fuzz_target!(init: gonio_fuzz::let_guards_catch(), |bytes: &[u8]| {
    if let Ok(table) = Table::decode(Path::new("a"), bytes) {
        let again = Table::decode(Path::new("a"), &table.encode()).unwrap();
        assert_eq!((again.rows.len(), again.columns.len()), (table.rows.len(), table.columns.len()));
    }
});
